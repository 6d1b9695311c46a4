"""Is a dataset what its manifest says, and physically possible?"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fairlead.core.artifacts import read_json, read_manifest, verify_files
from fairlead.core.errors import ArtifactError
from fairlead.data.shards import Shard
from fairlead.data.store import KIND, SCENES, require_layout, scenes_from_json, shards_of, summary
from fairlead.scenarios.registry import scenario as find_scenario
from fairlead.scenarios.scenario import Scenario

STRETCH = 1.02
"""Neighbouring rope points are at most this many link lengths apart."""
MARGIN = 0.01
"""How far [m] outside the scenario's bounds a gripper may be; in space, what it holds may hang out by half its
length."""


def info(folder: Path) -> dict[str, Any]:
    """What a dataset is: its configuration and counts, from the manifest alone."""
    manifest = read_manifest(folder, KIND)
    shards = sum(name.endswith(".parquet") for name in manifest.files)
    return {"folder": str(folder), **manifest.config, **manifest.extra, "shards": shards, "wall_s": manifest.wall_s}


def verify(folder: Path) -> dict[str, Any]:
    """Check hashes, columns, counts, ranges and the length of the rope in every shard; return the counts.

    Raises:
        ArtifactError: names the first damaged file, and what is wrong with it.
    """
    manifest = read_manifest(folder, KIND)
    verify_files(folder, manifest)
    scenario = find_scenario(manifest.config["scenario"])
    require_layout(folder, manifest, scenario)
    scenes = scenes_from_json(folder / SCENES, read_json(folder / SCENES))
    shards = []
    for path, shard in shards_of(folder, manifest):
        _verify_shard(path, shard, scenario, len(scenes), bounded=manifest.config["phase"] == 2)
        shards.append(shard)
    counts = summary(shards)
    for key, value in counts.items():
        if manifest.extra.get(key) != value:
            raise ArtifactError(
                folder, f"the shards hold {key} {value!r}, the manifest says {manifest.extra.get(key)!r}"
            )
    return counts


def _verify_shard(path: Path, shard: Shard, scenario: Scenario, scenes: int, bounded: bool) -> None:
    """Raise an ArtifactError that names the shard, the trajectory and the step of what cannot be.

    `bounded`: the states lie inside the scenario's bounds; in phase 1 nothing keeps them there.
    """
    states = shard.states
    points = states.reshape(*states.shape[:2], -1, 3)
    low, high = scenario.environment(()).bounds
    segments = np.linalg.norm(np.diff(scenario.layout.points_of(states), axis=-2), axis=-1)
    limit = STRETCH * scenario.link_length
    margin = np.full((points.shape[-2], 1), MARGIN)
    if not scenario.sampler.planar and np.isfinite(scenario.link_length):
        margin[len(scenario.layout.grippers) :] = scenario.layout.points * scenario.link_length / 2
    outside = ((points < low - margin) | (points > high + margin)).any((-1, -2))
    problems = {
        "a state is not finite": ~np.isfinite(states).all(axis=-1),
        "a point is outside the scenario's bounds": outside & bounded,
        f"the rope is stretched: neighbouring points more than {limit:.4f} m apart": (segments > limit).any(axis=-1),
    }
    for problem, where in problems.items():
        if where.any():
            row, step = np.argwhere(where)[0]
            raise ArtifactError(path, f"episode {shard.episode[row]}, step {step}: {problem}")
    if not np.isfinite(shard.actions).all():
        raise ArtifactError(path, "an action is not finite")
    if ((shard.scene < 0) | (shard.scene >= scenes)).any():
        raise ArtifactError(path, f"a scene_index is not among the {scenes} scenes of {SCENES}")
