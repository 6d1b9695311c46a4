"""Models that travel: weights in half precision where nothing is lost by it, and nothing that only training needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from safetensors.torch import save
from torch import Tensor

from fairlead.core.artifacts import MANIFEST, Manifest, read_manifest, sha256, write_atomic
from fairlead.core.records import Transitions
from fairlead.core.roles import ActionSampler, Dynamics, Environment
from fairlead.learning.distilled import distilled_from
from fairlead.learning.dynamics import dynamics_from
from fairlead.learning.full_dynamics import full_dynamics_from
from fairlead.learning.model_files import ModelFile, model_card, read_model
from fairlead.learning.recovery import LearnedRecovery, recovery_from
from fairlead.learning.trust import LearnedCheck, check_from

LOST = {"dynamics": 2e-4, "distilled": 2e-4, "full-dynamics": 2e-4, "trust": 0.01, "recovery": 0.01}
"""The largest difference that half precision may make: to a predicted coordinate or a spread [m]; to a probability."""
PACKED_FROM = "packed_from"
"""Key in a manifest's `extra`: the hash of the manifest of the model that this one was packed from."""


@dataclass(frozen=True)
class Probe:
    """Transitions in one environment, on which a model is compared with itself in half precision."""

    environment: Environment
    transitions: Transitions


Answer = Callable[[Probe], Float[np.ndarray, " number"]]


@dataclass(frozen=True)
class Packed:
    """What became of a model: halved if the largest difference found, in the units of `LOST`, is no more than that."""

    kind: str
    halved: bool
    difference: float
    bytes: int


def pack_model(folder: Path, scenario: str, sampler: ActionSampler, probes: Sequence[Probe], out: Path) -> Packed:
    """Write the model in `folder` to `out`, half as large where `probes` show no more difference than `LOST`.

    What says where the model comes from stays as it was: configuration, metrics, seed, inputs. One that is packed
    already is copied: packed again, it would say that nothing was lost.
    """
    manifest = read_manifest(folder, "model")
    kind = manifest.config["kind"]
    if PACKED_FROM in manifest.extra:
        for name in (*manifest.files, MANIFEST):
            write_atomic(out / name, (folder / name).read_bytes())
        return _packed(out, manifest)
    model = read_model(folder, kind, scenario)
    small = replace(model, tensors={name: _halved(tensor) for name, tensor in model.tensors.items()})
    answers = [np.concatenate(list(map(_ANSWERS[kind](m, sampler), probes))) for m in (model, small)]
    difference = float(np.abs(answers[0] - answers[1]).max())
    halved = difference <= LOST[kind]
    tensors = small.tensors if halved else model.tensors
    write_atomic(out / "model.safetensors", save(tensors, {"kind": kind, "network": model.network}))
    for name in ("config.json", "metrics.json"):
        write_atomic(out / name, (folder / name).read_bytes())
    origin = sha256(folder / MANIFEST)
    unit = "m" if kind in ("dynamics", "distilled", "full-dynamics") else "of probability"
    note = (
        "## Packed\n"
        f"- weights in {'half' if halved else 'single'} precision; half "
        f"precision changes {len(answers[0]):,} answers in benchmark scenes by at most {difference:.1e} {unit}\n"
        f"- from the model whose manifest has the SHA-256 {origin}\n"
    )
    card = model_card(manifest.config, manifest.seed, manifest.inputs, model.metrics)
    write_atomic(out / "card.md", f"{card}\n{note}")
    files = {name: sha256(out / name) for name in ("model.safetensors", "config.json", "metrics.json", "card.md")}
    extra = {PACKED_FROM: origin, "halved": halved, "difference": difference}
    packed = Manifest("model", manifest.config, manifest.seed, files, manifest.inputs, extra, manifest.wall_s)
    packed.write(out)
    return _packed(out, packed)


def _packed(out: Path, manifest: Manifest) -> Packed:
    size = sum((out / name).stat().st_size for name in manifest.files)
    return Packed(manifest.config["kind"], manifest.extra["halved"], manifest.extra["difference"], size)


def _halved(tensor: Tensor) -> Tensor:
    """In half precision, unless it is no tensor of floats or a value is beyond the range."""
    small = tensor.half()
    return small if tensor.is_floating_point() and bool(torch.isfinite(small).all()) else tensor


def _predicting(dynamics: Dynamics) -> Answer:
    def answer(probe: Probe) -> Float[np.ndarray, " number"]:
        found = dynamics.predict(probe.environment, probe.transitions.states, probe.transitions.actions)
        return np.append(found.mean, found.spread)

    return answer


def _trusting(check: LearnedCheck) -> Answer:
    def answer(probe: Probe) -> Float[np.ndarray, " number"]:
        environment, t = probe.environment, probe.transitions
        encodings = (check.encode(environment, states) for states in (t.states, t.next_states))
        return check.probability(environment, t, *encodings)

    return answer


def _recovering(policy: LearnedRecovery) -> Answer:
    def answer(probe: Probe) -> Float[np.ndarray, " number"]:
        t = probe.transitions
        return policy.probability(probe.environment, t.states, t.actions[:, None])[:, 0]

    return answer


_ANSWERS: Mapping[str, Callable[[ModelFile, ActionSampler], Answer]] = {
    "dynamics": lambda model, sampler: _predicting(dynamics_from(model)),
    "distilled": lambda model, sampler: _predicting(distilled_from(model)),
    "full-dynamics": lambda model, sampler: _predicting(full_dynamics_from(model)),
    "trust": lambda model, sampler: _trusting(check_from(model)),
    "recovery": lambda model, sampler: _recovering(recovery_from(model, sampler)),
}
