"""Both scenarios at a glance: benchmark scenes planned and executed with the models that come with the package."""

from __future__ import annotations

from pathlib import Path

from fairlead.core.budget import Budget
from fairlead.evaluation.bench import TrialsConfig
from fairlead.evaluation.planners import SHORT
from fairlead.evaluation.shipped import benchmark_scenes, shipped_models
from fairlead.report.page import write_report
from fairlead.reproduce.cameras import camera
from fairlead.reproduce.trials import Bar, try_all

SCENES, BUDGET = 2, Budget(seconds=30)
METHODS = {"dragging": ("trust-sdf", "accept-all"), "dual_arm": ("trust-sdf+recovery", "accept-all")}
"""What is tried, trust first."""


def demo(out: Path, workers: int, bar: Bar) -> Path:
    """Try, report; the path of the page. Run again, it goes on where it stopped.

    Raises:
        FairleadError: no models come with the package, or a folder in `out` holds something else.
    """
    for scenario in METHODS:
        try_methods(scenario, SCENES, BUDGET, out / "trials" / scenario, workers, bar)
    return write_report([out / "trials"], out / "report", cameras=camera)


def try_methods(scenario: str, scenes: int, budget: Budget, out: Path, workers: int, bar: Bar) -> Path:
    """Try the methods of a scenario on its first benchmark scenes, every trial with its trace; `out` is returned."""
    methods = METHODS[scenario]
    config = TrialsConfig(scenario, shipped_models(scenario), benchmark_scenes(scenario), methods, budget,
                          planner=SHORT, limit=scenes, traced=scenes, reference=methods[0], distilled=True)  # fmt: skip
    try_all(config, out, workers, bar)
    return out
