"""The sets of scenes that the line tries: the benchmark, hard ones, the authors' own; and random ones drawn here."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from fairlead.core.artifacts import read_json
from fairlead.core.errors import ArtifactError
from fairlead.evaluation.shipped import authors_scenes, benchmark_scenes, hard_scenes
from fairlead.scenarios.generate import generate
from fairlead.scenarios.scenario import Scenario
from fairlead.scenarios.scene_files import write_scenes

SETS: dict[str, Callable[[str], Path]] = {
    "benchmark": benchmark_scenes,
    "hard": hard_scenes,
    "authors": authors_scenes,
}
"""Called with the name of a scenario; ArtifactError where there are none."""
SCENES = 50
"""Drawn for a scenario whose benchmark does not come with the package."""


def scene_sets(
    scenario: Scenario, names: Iterable[str], out: Path, seed: int, tell: Callable[[str], None]
) -> dict[str, Path]:
    """The file of each set that there is; `tell` gets a line about each that there is not.

    Where no benchmark comes with the package, one is drawn into `out`.
    """
    found = {}
    for name in names:
        try:
            found[name] = SETS[name](scenario.name)
        except ArtifactError as error:
            if name == "benchmark":
                found[name] = drawn(scenario, out / "scenes.json", SCENES, seed)
            else:
                tell(f"the scenes '{name}' are left out: {error}")
    return found


def drawn(scenario: Scenario, path: Path, count: int, seed: int) -> Path:
    """The file of so many random scenes, drawn where it is not there yet; ArtifactError where it holds others."""
    source = f"fairlead scenes {scenario.name}, random, seed {seed}"
    if not path.exists():
        write_scenes(path, scenario.name, generate(scenario, "random", count, seed), source)
    held = read_json(path)
    if (held.get("source"), len(held.get("scenes", ()))) != (source, count):
        raise ArtifactError(path, f"other scenes than the {count} of '{source}'; remove it, or use another folder")
    return path
