"""A dataset while it is being recorded: what is finished, and how to go on from there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, final

from fairlead.core.artifacts import (
    MANIFEST,
    Manifest,
    read_json,
    read_manifest,
    sha256,
    verify_files,
    write_atomic,
    write_json,
)
from fairlead.core.errors import ArtifactError
from fairlead.core.layout import StateLayout
from fairlead.data.shards import Shard, read_shard, shard_name
from fairlead.data.store import KIND, SCENES, Obstacles, scenes_from_json, scenes_to_json, shards_of, summary

PROGRESS = "progress.json"


def _same_config(path: Path, found: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    for key in wanted:
        if found.get(key) != wanted[key]:
            problem = (
                f"another dataset is here: {key} is {found.get(key)!r}, not {wanted[key]!r}; choose another folder"
            )
            raise ArtifactError(path, problem)


@final
class Recording:
    """Begins the dataset in `folder`, or goes on after the shards that are finished and undamaged.

    Every step is ordered so that a process may be killed at any moment: the shard, then its scenes, then the progress
    that vouches for the shard by its hash and says how many of the scenes are its own.

    Args:
        folder: of the dataset; created where it does not exist.
        config: everything that the data depend on.

    Raises:
        ArtifactError: the folder holds something else, or a dataset of another configuration.
    """

    def __init__(self, folder: Path, config: Mapping[str, Any]) -> None:
        self.folder, self.config = folder, dict(config)
        self.layout = StateLayout(tuple(config["grippers"]), config["points"])
        self.scenes: list[Obstacles] = []
        self.manifest: Manifest | None = None
        self._done: list[dict[str, Any]] = []
        if (folder / MANIFEST).exists():
            self.manifest = read_manifest(folder, KIND)
            _same_config(folder, self.manifest.config, self.config)
            verify_files(folder, self.manifest)
            (folder / PROGRESS).unlink(missing_ok=True)
        elif (folder / PROGRESS).exists():
            self._resume(read_json(folder / PROGRESS))
        elif folder.exists() and any(not path.name.startswith(".") for path in folder.iterdir()):
            raise ArtifactError(folder, "not empty, and not an unfinished dataset; choose another folder")
        else:
            self._save()

    def _resume(self, progress: dict[str, Any]) -> None:
        _same_config(self.folder / PROGRESS, progress["config"], self.config)
        for entry in progress["shards"]:
            path = self.folder / shard_name(len(self._done))
            if not path.exists() or sha256(path) != entry["sha256"]:
                break
            self._done.append(entry)
        if self._done and self._done[-1]["scenes"]:
            path = self.folder / SCENES
            self.scenes = scenes_from_json(path, read_json(path))[: self._done[-1]["scenes"]]

    def _save(self) -> None:
        write_json(self.folder / PROGRESS, {"config": self.config, "shards": self._done})

    def __len__(self) -> int:
        """How many shards are finished."""
        return len(self._done)

    def last(self) -> Shard | None:
        """The shard that was finished last, as recorded."""
        if not self._done:
            return None
        return read_shard(self.folder / shard_name(len(self) - 1), self.layout, self.config["steps"])

    def append(self, shard: Shard, new_scenes: Sequence[Obstacles], **facts: float) -> None:
        """Add a shard and the scenes that begin with it; facts are numbers that the manifest will add up."""
        path = self.folder / shard_name(len(self))
        write_atomic(path, shard.to_bytes(self.layout))
        if new_scenes:
            self.scenes.extend(new_scenes)
            write_json(self.folder / SCENES, scenes_to_json(self.scenes))
        self._done.append({"sha256": sha256(path), "scenes": len(self.scenes), **facts})
        self._save()

    def finish(self) -> Manifest:
        """Write the manifest, last of all files, and return it; ArtifactError where every trajectory diverged."""
        names = [shard_name(i) for i in range(len(self))]
        files = {name: entry["sha256"] for name, entry in zip(names, self._done, strict=True)}
        files[SCENES] = sha256(self.folder / SCENES)
        total = {key: sum(entry[key] for entry in self._done) for key in ("diverged", "simulation_steps", "wall_s")}
        wall_s = total.pop("wall_s")
        manifest = Manifest(KIND, self.config, self.config["seed"], files, {}, {}, wall_s)
        facts = summary(shard for _, shard in shards_of(self.folder, manifest))
        if not facts["trajectories"]:
            raise ArtifactError(self.folder, f"all {total['diverged']} trajectories diverged: nothing to learn from")
        manifest.extra.update(facts, **total, scenes=len(self.scenes))
        manifest.write(self.folder)
        (self.folder / PROGRESS).unlink()
        self.manifest = manifest
        return manifest
