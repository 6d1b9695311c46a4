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

from fairlead.core.artifacts import Manifest, read_json, read_manifest, verify_files
from fairlead.core.errors import ArtifactError, FileFormatError, UnknownNameError
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


def shards_of(folder: Path, manifest: Manifest) -> Iterator[tuple[Path, Shard]]:
    """Read the shards in order."""
    layout = dataset_layout(manifest)
    for name in sorted(name for name in manifest.files if name.endswith(".parquet")):
        yield folder / name, read_shard(folder / name, layout, manifest.config["steps"])


def load(folder: Path, split: str, scenario: Scenario, first: int | None = None) -> Trajectories:
    """The trajectories of one split, 'train', 'validation' or 'test', of a dataset of `scenario`.

    With `first`, only those among the first so many of the dataset: the same as of a dataset of no more than these.

    Raises:
        ArtifactError: the folder is not a finished dataset, or one of another scenario; a file is damaged, or the split
            is empty, or there are fewer than the first so many trajectories.
        UnknownNameError: no such split.
    """
    if split not in SPLITS:
        raise UnknownNameError("split", split, SPLITS)
    manifest = read_manifest(folder, KIND)
    verify_files(folder, manifest)
    if (found := manifest.config["scenario"]) != scenario.name:
        raise ArtifactError(folder, f"a dataset of scenario '{found}'; one of '{scenario.name}' is needed here")
    scenes = scenes_from_json(folder / SCENES, read_json(folder / SCENES))
    recorded = manifest.config["trajectories"]
    stop = recorded if first is None else first
    if not 0 < stop <= recorded:
        raise ArtifactError(folder, f"the first {stop} trajectories are asked for; there are {recorded}")
    parts = [(s, (s.split == split) & (s.episode < stop)) for _, s in shards_of(folder, manifest)]
    if not any(chosen.any() for _, chosen in parts):
        raise ArtifactError(folder, f"no {split} trajectories; collect with at least eight lanes")
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
