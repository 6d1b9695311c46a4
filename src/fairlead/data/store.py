"""The dataset on disk: immutable shards, the scenes beside them, and a manifest written last.

shard-00000.parquet ...   one a trajectory number, see `fairlead.data.shards`
scenes.json               the obstacles of each scene_index
manifest.json             what it is and the SHA-256 of every file; a folder without it is not finished
progress.json             only while it is not finished: which shards are, with their hashes
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool

from fairlead.core.artifacts import Manifest, read_json, read_manifest, verify_files
from fairlead.core.errors import ArtifactError, FileFormatError
from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome, Trajectories
from fairlead.data.shards import SPLITS, Shard, read_shard
from fairlead.geometry.shapes import Box, Obstacle
from fairlead.scenarios.scenario import Scenario

KIND, SCENES = "dataset", "scenes.json"
Obstacles = tuple[Obstacle, ...]


def scenes_to_json(scenes: Sequence[Obstacles]) -> list[Any]:
    """Obstacles of each scene as JSON values."""
    return [[asdict(obstacle) for obstacle in scene] for scene in scenes]


def scenes_from_json(path: Path, value: Any) -> list[Obstacles]:
    """The inverse of `scenes_to_json`; `path` is named in the error."""

    def box(item: Any) -> Box:
        return Box(*(tuple(item[key]) for key in ("size", "position", "quaternion_xyzw")))

    try:
        return [tuple(Obstacle(o["name"], tuple(map(box, o["boxes"]))) for o in scene) for scene in value]
    except (KeyError, TypeError, ValueError) as error:
        raise FileFormatError(path, "scenes", f"not obstacles made of boxes ({error!r})") from None


def dataset_layout(manifest: Manifest) -> StateLayout:
    """How to read the states of a dataset."""
    return StateLayout(tuple(manifest.config["grippers"]), manifest.config["points"])


def require_layout(folder: Path, manifest: Manifest, scenario: Scenario) -> None:
    """ArtifactError where a dataset's states are not those of the scenario as it is now."""
    if (found := dataset_layout(manifest)) != scenario.layout:
        now = f"those of '{scenario.name}' are {scenario.layout}"
        raise ArtifactError(folder, f"its states are {found}, {now}; collect again")


def shards_of(folder: Path, manifest: Manifest) -> Iterator[tuple[Path, Shard]]:
    """Read the shards in order."""
    layout = dataset_layout(manifest)
    for name in sorted(name for name in manifest.files if name.endswith(".parquet")):
        yield folder / name, read_shard(folder / name, layout, manifest.config["steps"])


def load(folder: Path, scenario: Scenario, first: int | None = None) -> dict[str, Trajectories]:
    """The trajectories of each split, "train", "validation" and "test", of a dataset of `scenario`.

    With `first`, only those among the first so many of the dataset: the same as of a dataset of no more than these.

    Raises:
        ArtifactError: the folder is not a finished dataset, or one of another scenario; a file is damaged, or a split
            is empty, or there are fewer than the first so many trajectories.
    """
    manifest = read_manifest(folder, KIND)
    verify_files(folder, manifest)
    if (found := manifest.config["scenario"]) != scenario.name:
        raise ArtifactError(folder, f"a dataset of scenario '{found}'; one of '{scenario.name}' is needed here")
    require_layout(folder, manifest, scenario)
    recorded = manifest.config["trajectories"]
    stop = recorded if first is None else first
    if not 0 < stop <= recorded:
        raise ArtifactError(folder, f"the first {stop} trajectories are asked for; there are {recorded}")
    scenes = scenes_from_json(folder / SCENES, read_json(folder / SCENES))
    shards = [shard for _, shard in shards_of(folder, manifest)]
    for split in SPLITS:
        if not any(_rows(shard, split, stop).any() for shard in shards):
            raise ArtifactError(folder, f"no {split} trajectories; collect with at least eight lanes")
    return {split: _trajectories(scenario, scenes, [(s, _rows(s, split, stop)) for s in shards]) for split in SPLITS}


def _rows(shard: Shard, split: str, stop: int) -> Bool[np.ndarray, " row"]:
    return np.asarray((shard.split == split) & (shard.episode < stop))


def _trajectories(
    scenario: Scenario, scenes: Sequence[Obstacles], parts: Sequence[tuple[Shard, Bool[np.ndarray, " row"]]]
) -> Trajectories:
    """The chosen rows of some shards, with the environments that they need."""
    used, scene = np.unique(np.concatenate([shard.scene[chosen] for shard, chosen in parts]), return_inverse=True)
    return Trajectories(
        layout=scenario.layout,
        states=np.concatenate([shard.states[chosen] for shard, chosen in parts]),
        actions=np.concatenate([shard.actions[chosen] for shard, chosen in parts]),
        outcomes=np.concatenate([shard.outcomes[chosen] for shard, chosen in parts]),
        scene=scene,
        environments=[scenario.environment(scenes[index]) for index in used],
    )


def summary(shards: Iterable[Shard]) -> dict[str, Any]:
    """Counts over shards: trajectories (all, and by split), transitions, how the actions ended, simulated seconds."""
    outcomes, splits, seconds = Counter[int](), Counter[str](), 0.0
    for shard in shards:
        outcomes.update(shard.outcomes.ravel().tolist())
        splits.update(shard.split.tolist())
        seconds += float(shard.seconds.sum(dtype=float))
    return {
        "trajectories": splits.total(),
        "splits": {split: splits[split] for split in SPLITS},
        "transitions": outcomes.total(),
        "outcomes": {outcome.label: outcomes[i] for i, outcome in enumerate(ActionOutcome) if outcomes[i]},
        "simulated_s": round(seconds, 3),
    }
