"""Finds what a report is about: finished folders of trials, models, datasets and evidence, told apart by manifest."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from fairlead.core.artifacts import MANIFEST, read_json, read_jsonl, read_manifest, sha256
from fairlead.core.errors import ArtifactError


@dataclass(frozen=True)
class TrialSet:
    """A folder of trials: every method on one set of scenes. `name`, the folder's by default, tells it from others."""

    folder: Path
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", self.name or self.folder.name)

    @cached_property
    def config(self) -> dict[str, Any]:
        """Scenario, scenes, budget, protocol, methods, seeds."""
        return read_manifest(self.folder, "trials").config

    @cached_property
    def rows(self) -> list[dict[str, Any]]:
        """The trials, sorted."""
        rows = read_jsonl(self.folder / "trials.jsonl")
        return sorted(rows, key=lambda row: (row["method"], row["scene"], row["seed"]))

    @cached_property
    def summary(self) -> dict[str, Any]:
        """The statistics that evaluation wrote; its methods in the order to report."""
        found = read_json(self.folder / "summary.json")
        return {**found, "methods": {name: found["methods"][name] for name in found["order"]}}

    @property
    def reference(self) -> str:
        """The method that is compared with the others. Older summaries do not name it: it was their first."""
        return self.summary.get("reference", self.summary["order"][0])

    @cached_property
    def scenes(self) -> list[dict[str, Any]]:
        """The scenes that were tried, as a scene file writes them; none where the file did not travel with the rows."""
        path = self.folder / "scenes.json"
        return read_json(path)["scenes"] if path.exists() else []

    @property
    def rows_of(self) -> dict[str, list[dict[str, Any]]]:
        """Method -> its trials, in the order of the summary."""
        return {name: [row for row in self.rows if row["method"] == name] for name in self.summary["methods"]}

    def trace(self, method: str, scene: str, seed: int) -> Path:
        """The folder of a trial's trace; it is there where one was kept."""
        return self.folder / "traces" / method / f"{scene}-{seed}"


@dataclass(frozen=True)
class Model:
    """A trained model: its metrics and learning curves. `name` is the folder's, with as much before it as tells."""

    folder: Path
    name: str

    @cached_property
    def config(self) -> dict[str, Any]:
        """Kind, network, scenario, settings."""
        return read_manifest(self.folder, "model").config

    @property
    def kind(self) -> str:
        """What it models: dynamics, distilled, full-dynamics, trust or recovery."""
        return self.config["kind"]

    @property
    def scalars(self) -> dict[str, float]:
        """The metrics that are single numbers, those on test data by their plain names."""
        found = {**self.metrics, **self.metrics.get("test", {})}
        return {
            key: value
            for key, value in found.items()
            if isinstance(value, int | float) and not (key.startswith("test_") and key[5:] in found)
        }

    @cached_property
    def metrics(self) -> dict[str, Any]:
        """What was measured when it was trained."""
        return read_json(self.folder / "metrics.json")

    @cached_property
    def curves(self) -> list[dict[str, float]]:
        """One row an epoch: stage, epoch, loss, score."""
        path = self.folder / "curves.csv"
        if not path.exists():
            return []
        return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(path.open())]


@dataclass(frozen=True)
class Sources:
    """Everything found, each kind in the order of the folders."""

    trials: tuple[TrialSet, ...]
    models: tuple[Model, ...]
    datasets: tuple[Path, ...]
    evidence: tuple[Path, ...]
    sensitivity: tuple[Path, ...]


_KINDS = ("trials", "model", "dataset", "evidence", "sensitivity")


def find_sources(folders: Sequence[Path]) -> Sources:
    """Look for finished artifacts in the folders and everywhere below, but not in the parts of a threshold sensitivity.

    Raises:
        ArtifactError: a folder does not exist, or none holds anything finished.
    """
    kinds: dict[str, dict[Path, None]] = {kind: {} for kind in _KINDS}
    for folder in folders:
        if not folder.is_dir():
            raise ArtifactError(folder, "no such folder")
        for path in sorted(folder.rglob(MANIFEST)):
            manifest = read_json(path)
            if isinstance(manifest, dict):  # others write files of this name, too
                kinds.setdefault(str(manifest.get("kind")), {})[path.parent] = None
    wholes = kinds["sensitivity"].keys()
    found = {kind: tuple(path for path in kinds[kind] if wholes.isdisjoint(path.parents)) for kind in _KINDS}
    if not any(found.values()):
        raise ArtifactError(folders[0], f"nothing finished here or below (no {MANIFEST} of trials or models)")
    return Sources(
        tuple(map(TrialSet, found["trials"], told_apart(found["trials"], "-"))),
        _models(found["model"]),
        found["dataset"],
        found["evidence"],
        found["sensitivity"],
    )


def _models(folders: Sequence[Path]) -> tuple[Model, ...]:
    """The models in these folders; of copies of one, the first."""
    different = list({sha256(folder / MANIFEST): folder for folder in reversed(folders)}.values())[::-1]
    return tuple(map(Model, different, told_apart(different, "/")))


def told_apart(folders: Sequence[Path], joint: str) -> list[str]:
    """A name for each folder: its own, with as many of those above it as tell it from the others."""
    parts, names = [folder.absolute().parts for folder in folders], []
    for of in parts:
        depths = range(1, len(of))
        alone = (d for d in depths if sum(other[-d:] == of[-d:] for other in parts) == 1)
        names.append(joint.join(of[-next(alone, 1) :]))
    return names
