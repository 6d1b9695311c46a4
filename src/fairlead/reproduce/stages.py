"""Stages between folders. Each is skipped where its result is there already, made from the same inputs and settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

from fairlead.core.artifacts import MANIFEST, alone, read_json, read_manifest, sha256, verify_files, write_atomic
from fairlead.core.errors import ArtifactError
from fairlead.data.store import load
from fairlead.evaluation.evidence import write_evidence
from fairlead.evaluation.methods import with_arms
from fairlead.learning.distilled import DistilledConfig, train_distilled
from fairlead.learning.dynamics import DynamicsConfig, train_dynamics
from fairlead.learning.full_dynamics import FullDynamicsConfig, train_full_dynamics
from fairlead.learning.model_files import Job
from fairlead.learning.recovery import RecoveryConfig, train_recovery
from fairlead.learning.registry import load_check, load_delta, load_dynamics
from fairlead.learning.rollout import Splits
from fairlead.learning.trust import train_trust, trust_config_from
from fairlead.learning.trust_network import TrustConfig
from fairlead.scenarios.scenario import Scenario

CONTACT_M = 0.005
"""A rope point this near to an obstacle's surface, beyond the rope's radius, is in contact in the evidence."""


class Part(NamedTuple):
    """The first so many trajectories of a dataset, which a recording of no more than these would hold; None for all."""

    folder: Path
    trajectories: int | None = None


Data = Path | Part


def _part(data: Data) -> Part:
    return data if isinstance(data, Part) else Part(data)


def splits(data: Data, scenario: Scenario, phase: int) -> Splits:
    """The three splits of a dataset, or of a part of one.

    Raises:
        ArtifactError: not a finished dataset, or one of another scenario or phase.
    """
    part = _part(data)
    found = read_manifest(part.folder, "dataset").config["phase"]
    if found != phase:
        raise ArtifactError(part.folder, f"a dataset of phase '{found}'; one of '{phase}' is needed here")
    return Splits(**load(part.folder, scenario, part.trajectories))


def _hashes(inputs: Mapping[str, Data]) -> dict[str, str]:
    """Of the manifest of each input; the name of a part says how large it is."""
    found = {}
    for name, data in inputs.items():
        folder, count = _part(data)
        if not (folder / MANIFEST).exists():
            raise ArtifactError(folder, f"no {MANIFEST}: not the finished {name} that is needed here")
        found[name if count is None else f"{name}, first {count} trajectories"] = sha256(folder / MANIFEST)
    return found


def finished(folder: Path, config: Any, inputs: Mapping[str, Data], seed: int) -> bool:
    """Whether `folder` holds the model of this configuration, seed and these inputs, undamaged.

    Raises:
        ArtifactError: it holds another model: nothing finished is overwritten.
    """
    if not (folder / MANIFEST).exists():
        return False
    manifest = read_manifest(folder, "model")
    verify_files(folder, manifest)
    values = manifest.config["config"]
    found = {"settings": values.get(manifest.config["kind"], values), "inputs": manifest.inputs, "seed": manifest.seed}
    wanted = {"settings": _plain(asdict(config)), "inputs": _hashes(inputs), "seed": seed}
    for name, value in wanted.items():
        if found[name] != value:
            what = f"other {name} ({_difference(found[name], value)})"
            raise ArtifactError(folder, f"holds a model of {what}; choose another folder, or remove this one")
    return True


def _difference(found: Any, wanted: Any) -> str:
    """The first that differs of two values, or of what two tables hold."""
    if not (isinstance(found, dict) and isinstance(wanted, dict)):
        return f"{found}, not {wanted}"
    key = next(key for key in {**found, **wanted} if found.get(key, "-") != wanted.get(key, "-"))
    return f"{key}: {found.get(key, '-')}, not {wanted.get(key, '-')}"


def reused(source: Path, folder: Path) -> None:
    """Copy a finished model, its manifest last.

    Raises:
        ArtifactError: `folder` holds another one already: nothing finished is overwritten.
    """
    manifest = read_manifest(source, "model")
    if (folder / MANIFEST).exists():
        if sha256(folder / MANIFEST) != sha256(source / MANIFEST):
            raise ArtifactError(folder, f"holds another model than {source}; choose another folder, or remove this one")
        return verify_files(folder, manifest)
    for name in (*manifest.files, MANIFEST):
        write_atomic(folder / name, (source / name).read_bytes())


def _plain(value: Any) -> Any:
    """A configuration as JSON gives it back."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def train_once(
    scenario: Scenario, folder: Path, config: Any, inputs: Mapping[str, Data], seed: int, train: Callable[[Job], object]
) -> None:
    """Train a model where its folder does not hold it yet; `finished` says what is refused."""
    job = Job(folder, scenario.name, seed, _hashes(inputs))
    with alone(folder):
        if not finished(folder, config, inputs, seed):
            train(job)


def dynamics(scenario: Scenario, data: Data, config: DynamicsConfig, out: Path, seed: int) -> None:
    """Train the unconstrained dynamics on phase 1 data."""
    train_once(scenario, out, config, {"data": data}, seed,
               lambda job: train_dynamics(splits(data, scenario, 1), config, job))  # fmt: skip


def distilled(scenario: Scenario, data: Data, dynamics: Path, config: DistilledConfig, out: Path, seed: int) -> None:
    """Distil the dynamics on the states of phase 2 data."""

    def train(job: Job) -> None:
        ensemble = load_dynamics(dynamics, scenario.kin, job.device)
        train_distilled(ensemble, splits(data, scenario, 2), scenario.sampler, config, job)

    train_once(scenario, out, config, {"data": data, "dynamics": dynamics}, seed, train)


def full_dynamics(scenario: Scenario, data: Data, config: FullDynamicsConfig, out: Path, seed: int) -> None:
    """Train the full dynamics baseline on data recorded as in phase 2."""
    train_once(scenario, out, config, {"data": data}, seed,
               lambda job: train_full_dynamics(splits(data, scenario, 2), config, job))  # fmt: skip


def trust(scenario: Scenario, data: Data, dynamics: Path, config: TrustConfig, out: Path, seed: int) -> None:
    """Train a trust classifier on phase 2 data, labelled at the delta of the dynamics or of the configuration."""

    def train(job: Job) -> None:
        model = load_dynamics(dynamics, scenario.kin, job.device)
        delta = load_delta(dynamics, scenario.kin) if config.delta_m is None else config.delta_m
        train_trust(model, splits(data, scenario, 2), delta, config, job)

    train_once(scenario, out, config, {"data": data, "dynamics": dynamics}, seed, train)


def recovery(
    scenario: Scenario, data: Data, dynamics: Path, trust: Path, config: RecoveryConfig, out: Path, seed: int
) -> None:
    """Train recovery on the states of phase 2 data in which the classifier accepts nothing."""

    def train(job: Job) -> None:
        model = load_dynamics(dynamics, scenario.kin, job.device)
        check = load_check(trust, scenario.kin, job.device)
        trusted = with_arms(check, scenario)
        train_recovery(model, check, trusted, scenario.sampler, splits(data, scenario, 2), config, job)

    train_once(scenario, out, config, {"data": data, "dynamics": dynamics, "trust": trust}, seed, train)


def evidence(scenario: Scenario, data: Data, dynamics: Path, trust: Path, out: Path, seed: int) -> None:
    """Write what the report draws of single examples: Fig. 3, Fig. 5 and Fig. S1 of the paper."""
    inputs = _hashes({"data": data, "dynamics": dynamics, "trust": trust})
    with alone(out):
        if (out / MANIFEST).exists() and (manifest := read_manifest(out, "evidence")).inputs == inputs:
            return verify_files(out, manifest)
        grid = trust_config_from(read_json(trust / "config.json")["config"]).grid
        write_evidence(
            load_dynamics(dynamics, scenario.kin),
            load_check(trust, scenario.kin),
            splits(data, scenario, 2).test,
            read_json(trust / "metrics.json")["delta_m"],
            grid,
            scenario.rope_radius + CONTACT_M,
            out,
            seed,
            inputs,
        )
