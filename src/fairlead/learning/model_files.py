"""A model on disk: tensors, config, metrics, card and curves in a folder, with a manifest written last."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import Tensor, nn

from fairlead.core.artifacts import (
    MANIFEST,
    Manifest,
    config_hash,
    read_json,
    read_manifest,
    sha256,
    verify_files,
    write_atomic,
    write_json,
)
from fairlead.core.errors import ArtifactError
from fairlead.core.layout import StateLayout
from fairlead.learning.device import device_name, training_device
from fairlead.learning.fit import CHECKPOINT

Names = str | tuple[str, ...]
KINDS = {
    "dynamics": "Predicts what an action does to the rope where nothing constrains it (an ensemble).",
    "distilled": "Predicts what the dynamics' ensemble predicts, its spread too: one network, faster to plan with.",
    "full-dynamics": "Predicts what an action does to the rope among obstacles: the baseline that needs no check.",
    "trust": "The probability that a predicted transition is reliable.",
    "recovery": "The probability that an action leads out of a state where no prediction is reliable.",
}


@dataclass(frozen=True)
class Job:
    """Where a model goes and what it is made from.

    Args:
        folder: the model's folder; training that was interrupted goes on from the checkpoint in it.
        scenario: name of the scenario whose data these are.
        seed: everything random in training derives from it.
        inputs: name of each input (a dataset, another model) to the hash of its manifest.
        device: where training computes.
    """

    folder: Path
    scenario: str
    seed: int = 0
    inputs: Mapping[str, str] = field(default_factory=dict)
    device: torch.device = field(default_factory=training_device)

    def key(self, kind: str, config: Any) -> str:
        """What a checkpoint must agree with to be continued."""
        about = {"kind": kind, "config": asdict(config), "scenario": self.scenario, "seed": self.seed}
        return config_hash({**about, "inputs": dict(self.inputs)})


@dataclass(frozen=True)
class ModelFile:
    """A model read from its folder, its hashes verified."""

    folder: Path
    network: str
    layout: StateLayout
    config: dict[str, Any]
    metrics: dict[str, Any]
    tensors: dict[str, Tensor]

    def load_into(self, module: nn.Module) -> None:
        """Put the tensors into a module, and the module into evaluation mode."""
        try:
            module.load_state_dict(dict(self.tensors))
        except RuntimeError as error:
            problem = str(error).splitlines()[-1].strip()
            raise ArtifactError(
                self.folder, f"the tensors do not fit the network '{self.network}' ({problem})"
            ) from None
        module.requires_grad_(False).eval()


def save_model(
    job: Job,
    kind: str,
    network: str,
    layout: StateLayout,
    config: Any,
    tensors: Mapping[str, Tensor],
    metrics: Mapping[str, Any],
    wall_s: float,
) -> None:
    """Write a model's folder; the manifest comes last, the checkpoint goes."""
    folder = job.folder
    (folder / MANIFEST).unlink(missing_ok=True)
    contiguous = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    write_atomic(folder / "model.safetensors", save(contiguous, {"kind": kind, "network": network}))
    about = {
        "kind": kind,
        "network": network,
        "scenario": job.scenario,
        "layout": {"grippers": list(layout.grippers), "points": layout.points},
        "config": asdict(config),
    }
    write_json(folder / "config.json", about)
    write_json(folder / "metrics.json", dict(metrics))
    write_atomic(folder / "card.md", model_card(about, job.seed, job.inputs, metrics))
    names = ("model.safetensors", "config.json", "metrics.json", "card.md", "curves.csv", "curves.png")
    files = {name: sha256(folder / name) for name in names if (folder / name).exists()}
    extra = {"device": device_name(job.device)}
    Manifest("model", about, job.seed, files, dict(job.inputs), extra, wall_s).write(folder)
    (folder / CHECKPOINT).unlink(missing_ok=True)


def read_model(folder: Path, kind: str, scenario: Names) -> ModelFile:
    """Read a model of a scenario, or of one of several.

    Raises:
        ArtifactError: no finished model there, another kind, another scenario, or a damaged file.
    """
    verify_files(folder, read_manifest(folder, "model"))
    about = read_json(folder / "config.json")
    if about["kind"] != kind:
        raise ArtifactError(folder, f"a '{about['kind']}' model; a '{kind}' model is needed here")
    names = (scenario,) if isinstance(scenario, str) else scenario
    if about["scenario"] not in names:
        needed = " or ".join(f"'{name}'" for name in names)
        raise ArtifactError(folder, f"a model of scenario '{about['scenario']}'; one of {needed} is needed here")
    try:
        tensors = load_file(folder / "model.safetensors")
    except SafetensorError as error:
        raise ArtifactError(folder / "model.safetensors", f"not readable ({error})") from None
    layout = StateLayout(tuple(about["layout"]["grippers"]), about["layout"]["points"])
    metrics = read_json(folder / "metrics.json")
    return ModelFile(folder, about["network"], layout, about["config"], metrics, tensors)


def model_card(about: Mapping[str, Any], seed: int, inputs: Mapping[str, str], metrics: Mapping[str, Any]) -> str:
    """What a model is, what was measured, what it was made with; `about` is as `config.json` has it."""
    lines = [
        f"# {about['scenario']}: {about['kind']} ({about['network']})",
        "",
        KINDS[about["kind"]],
        "",
        "## Measured",
        *(f"- {name}: {text}" for name, value in metrics.items() if (text := _number(value))),
        "",
        "## Made with",
        f"- seed {seed}",
        *(f"- {name}: {digest}" for name, digest in inputs.items()),
        *(f"- {name} = {value}" for name, value in about["config"].items()),
        "",
        "Use only with the scenario it was trained on; outside its training data it is a guess.",
        "",
    ]
    return "\n".join(lines)


def _number(value: Any) -> str:
    """A metric in words: a number, or the numbers of a split; nothing for lists."""
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {text}" for name, item in value.items() if (text := _number(item)))
    return f"{value:.4g}" if isinstance(value, float) else str(value) if isinstance(value, int | str) else ""
