"""The trials of the line: every method on every set of scenes, each set a folder and a section of the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any

from fairlead.evaluation.bench import TrialsConfig
from fairlead.evaluation.methods import find_method
from fairlead.evaluation.trials import Trials
from fairlead.execution.trial import Protocol
from fairlead.reproduce.presets import Preset
from fairlead.scenarios.scenario import Scenario

Bar = Callable[[str, int, str], AbstractContextManager[Callable[[int], None]]]
"""Opens a progress bar with a title, a total and a unit; yields a function that advances it."""


def try_all(config: TrialsConfig, out: Path, workers: int, bar: Bar) -> dict[str, Any]:
    """Run the trials that the folder `out` lacks; the summary of all that it holds."""
    trials = Trials(config, out)
    with bar(f"{config.scenario} {out.parent.name}/{out.name}", len(trials.missing), "trials") as advance:
        return trials.run(workers, lambda row: advance(1))


def try_sets(
    scenario: Scenario, preset: Preset, models: Path, sets: Mapping[str, Path], out: Path, workers: int, bar: Bar
) -> None:
    """Try the methods of a preset on each set of scenes in `out`/SET, and what the preset wants besides.

    SET-protocol-paper has the methods that were stuck and have no recovery, SET-counted those of a counted budget,
    SET-improved those with a better planner.
    """
    for name, scenes in sets.items():
        first = name == next(iter(sets))
        config = TrialsConfig(scenario.name, models, scenes, preset.methods, preset.budget, planner=preset.planner,
                              seeds=preset.seeds, limit=preset.sets[name], traced=preset.traced,
                              reference=preset.methods[0])  # fmt: skip
        found = try_all(config, out / name, workers, bar)["methods"]
        untraced = replace(config, traced=0)
        stuck = tuple(m for m in preset.methods if found[m]["stuck_trials"] and find_method(m).recovery == "none")
        if preset.both_protocols and stuck:
            papers = replace(untraced, methods=stuck, protocol=Protocol.PAPER, reference=None)
            try_all(papers, out / f"{name}-protocol-paper", workers, bar)
        if preset.counted and first:
            counted = replace(untraced, budget=preset.counted, seeds=preset.seeds[:1])
            try_all(counted, out / f"{name}-counted", workers, bar)
        if preset.improved:
            improved = replace(untraced, methods=preset.improved, planner=preset.improved_planner,
                               budget=preset.improved_budget, seeds=preset.improved_seeds, reference=preset.improved[0],
                               distilled=preset.distilled is not None)  # fmt: skip
            try_all(improved, out / f"{name}-improved", workers, bar)
