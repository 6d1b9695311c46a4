"""Trained models made ready to travel with the package: packed one by one, with a card for all of them."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from fairlead.core.artifacts import MANIFEST, read_manifest, write_atomic
from fairlead.core.errors import ArtifactError
from fairlead.core.records import Transitions
from fairlead.core.streams import stream
from fairlead.evaluation.models import Models
from fairlead.evaluation.shipped import benchmark_scenes
from fairlead.learning.packing import PACKED_FROM, Packed, Probe, pack_model
from fairlead.learning.registry import load_dynamics
from fairlead.scenarios.registry import scenario as find_scenario
from fairlead.scenarios.scenario import Scenario

SCENES, ACTIONS, STEPS = 10, 32, 2
"""Models are compared with themselves in half precision on random actions from the starts of so many scenes."""


def pack(folder: Path, out: Path, scenes: Path | None = None) -> dict[str, Packed]:
    """Pack every finished model in `folder` into a new folder `out`; what became of each, by its name.

    They are compared in `scenes`, a scene file, or in the benchmark scenes that come with the package.

    Raises:
        ArtifactError: `out` exists, no models are there, or one was trained on dynamics other than those beside it.
    """
    if out.exists():
        raise ArtifactError(out, "exists already; remove it or choose another folder")
    names = sorted(path.parent.name for path in folder.glob(f"*/{MANIFEST}"))
    if not names:
        raise ArtifactError(folder, "no finished models here (folders with a manifest.json)")
    scenario = find_scenario(read_manifest(folder / names[0], "model").config["scenario"])
    models = Models(folder, scenario)
    probes = _probes(scenario, models, scenes or benchmark_scenes(scenario.name))
    staging = out.with_name(f".{out.name}.tmp")
    shutil.rmtree(staging, ignore_errors=True)
    packed = {
        name: pack_model(models.folder_of(name), scenario.name, scenario.sampler, probes, staging / name)
        for name in names
    }
    write_atomic(staging / "README.md", _readme(scenario, models, packed))
    os.rename(staging, out)
    return packed


def _probes(scenario: Scenario, models: Models, scenes: Path) -> list[Probe]:
    """What the dynamics predict of a few random actions in a row, scene by scene."""
    dynamics, rng = load_dynamics(models.folder_of("dynamics"), scenario.name), stream(0, "pack", scenario.name)
    probes = []
    for scene in scenario.scenes(scenes).scenes[:SCENES]:
        environment = scenario.environment(scene.obstacles)
        states = np.repeat(scene.state(scenario.layout)[None], ACTIONS, axis=0)
        for _ in range(STEPS):
            actions = scenario.sampler.propose(states, rng)
            found = dynamics.predict(environment, states, actions)
            probes.append(Probe(environment, Transitions(states, actions, found.mean, found.spread)))
            states = found.mean
    return probes


def _readme(scenario: Scenario, models: Models, packed: Mapping[str, Packed]) -> str:
    """The card of all models."""
    lines = [
        f"# Trained models: {scenario.name}",
        "",
        f"`fairlead plan {scenario.name}` and `evaluate` use these models where no `--models` is given.",
        "",
        "| model | weights | MB | halving changes at most | seed | dataset | SHA-256 of the original's manifest |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, of in packed.items():
        manifest = read_manifest(models.folder / name, "model")
        data = next((digest[:12] + name[4:] for name, digest in manifest.inputs.items() if name[:4] == "data"), "-")
        precision = "half" if of.halved else "single"
        lines.append(
            f"| [{name}]({name}/card.md) | {precision} | {of.bytes / 1e6:.1f} | {of.difference:.1e} "
            f"| {manifest.seed} | {data} | {manifest.extra.get(PACKED_FROM, models.hashes[name])[:12]} |"
        )
    return "\n".join([
        *lines,
        "",
        "Each model's `card.md` tells what was measured on its test data, its settings and what it was trained on; "
        "`metrics.json` has every number. The change is of a prediction [m] or of a probability.",
        "",
        f"Limits: trained in simulation, on the rope, the motions and the obstacles of `{scenario.name}` alone; for "
        "another rope, robot or world they are guesses, trust included. "
        "Trust and recovery belong to the dynamics beside them.",
        "",
    ])  # fmt: skip
