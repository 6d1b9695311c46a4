"""The whole state of training in one file, without pickle: tensors, and scalars as JSON in the file's header."""

from __future__ import annotations

import copy
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn

from fairlead.core.artifacts import write_atomic
from fairlead.core.errors import ArtifactError

Tensors = dict[str, Tensor]


@dataclass(frozen=True)
class Snapshot:
    """Weights now, Adam's moments by parameter, the best weights so far, and the scalars of the loop."""

    module: Tensors
    adam: Tensors
    best: Tensors
    scalars: dict[str, Any]

    @classmethod
    def take(
        cls, module: nn.Module, optimiser: torch.optim.Adam, best: Tensors, scalars: Mapping[str, Any]
    ) -> Snapshot:
        """What must be kept to go on from here: a copy, for training changes its tensors in place."""
        moments = {
            f"{index}.{name}": value
            for index, values in optimiser.state_dict()["state"].items()
            for name, value in values.items()
        }
        return cls(_copied(module.state_dict()), _copied(moments), _copied(best), copy.deepcopy(dict(scalars)))

    def restore(self, module: nn.Module, optimiser: torch.optim.Adam) -> None:
        """Put module and optimiser back to where they were."""
        module.load_state_dict(self.module)
        state: dict[int, Tensors] = {}
        for key, value in self.adam.items():
            index, _, name = key.partition(".")
            state.setdefault(int(index), {})[name] = value
        optimiser.load_state_dict({"state": state, "param_groups": optimiser.state_dict()["param_groups"]})


def _copied(tensors: Mapping[str, Tensor]) -> Tensors:
    return {name: value.detach().clone() for name, value in tensors.items()}


def write_snapshot(path: Path, key: str, snapshot: Snapshot) -> None:
    """Write a snapshot atomically. `key` says whose it is."""
    tensors = {
        f"{part}/{name}": value.contiguous()
        for part in ("module", "adam", "best")
        for name, value in getattr(snapshot, part).items()
    }
    write_atomic(path, save(tensors, {"key": key, "scalars": json.dumps(snapshot.scalars)}))


def read_snapshot(path: Path, key: str) -> Snapshot:
    """Read a snapshot; refuse one of another key."""
    parts: dict[str, Tensors] = {"module": {}, "adam": {}, "best": {}}
    try:
        with safe_open(path, "pt") as file:
            header = file.metadata()
            for name in file.keys():  # noqa: SIM118 (not a mapping)
                part, _, rest = name.partition("/")
                parts[part][rest] = file.get_tensor(name)
    except (SafetensorError, OSError) as error:
        raise ArtifactError(path, f"not a readable checkpoint ({error})") from None
    if header["key"] != key:
        raise ArtifactError(path, "belongs to training with another configuration; remove it or choose another folder")
    return Snapshot(parts["module"], parts["adam"], parts["best"], json.loads(header["scalars"]))
