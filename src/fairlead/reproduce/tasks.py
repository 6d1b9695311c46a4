"""The paper's real tasks, as mock-ups, in one folder: models, trials in another world than that of training, report.

Paper, "Physical robot demonstrations": the dynamics are reused as trained, and for dragging the classifier
too. For two arms these are trained on data from surroundings like the task's. Those are drawn from other streams than
the scenes that are tried, so none of them is seen in training.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from fairlead.core.budget import Budget
from fairlead.data.collect import CollectConfig
from fairlead.evaluation.bench import TrialsConfig
from fairlead.evaluation.shipped import benchmark_scenes, shipped_models
from fairlead.learning.registry import use_threads
from fairlead.report.page import write_report
from fairlead.reproduce import stages
from fairlead.reproduce.cameras import camera
from fairlead.reproduce.line import recorded
from fairlead.reproduce.presets import Preset, preset
from fairlead.reproduce.trials import Bar, try_all
from fairlead.scenarios.other_world import MOCKUP
from fairlead.scenarios.registry import TASKS, scenario
from fairlead.scenarios.scenario import Scenario

REAL_TASKS = "real_tasks"
"""The name of them all."""
REUSED = {"dragging": ("dynamics", "trust-sdf"), "dual_arm": ("dynamics",)}
"""By the base of a task: the models that come with Fairlead for the base and are used as they are. Dragging has no
recovery to reuse: it is trained on data of dragging, where stuck states are so rare that it mostly acts at random."""
METHODS = ("trust-sdf+recovery", "trust-sdf+planned-recovery", "accept-all", "accept-all+arms", "collision-check")
BUDGET = Budget(seconds=120)
OBSTACLES_EVERY = 2
"""Surroundings change after so many trajectories: many of them matter more to a classifier than long stays in one."""


def reproduce_tasks(size: str, out: Path, seed: int, threads: int, bar: Bar) -> Path:
    """Reuse, collect, train, try and report; the path of the page. Run again, it goes on where it stopped.

    Args:
        size: name of the preset of each task's base (see `sizes_of`), for its data, classifier and recovery. With a
            counted budget it gives budget and number of scenes, too; else all scenes are tried for `BUDGET`.
        out: folder of everything.
        seed: of data and training; that of the trials is 0.
        threads: of the simulator and of training, and the number of processes that run trials.
        bar: opens a progress bar.

    Raises:
        FairleadError: no such preset, or a folder in `out` holds something that this line did not make.
    """
    use_threads(threads)
    tasks = [scenario(spec.name) for spec in TASKS]
    sizes = [sizes_of(task, size) for task in tasks]
    for task, of in zip(tasks, sizes, strict=True):
        models = _models(task, of, out, seed, threads, bar)
        counted = math.isfinite(of.budget.extensions)
        config = TrialsConfig(
            task.name, models, benchmark_scenes(task.name), METHODS, of.budget if counted else BUDGET,
            limit=of.sets["benchmark"] if counted else None, traced=of.traced, reference=METHODS[0], differences=MOCKUP,
            remember=True,
        )  # fmt: skip
        try_all(config, out / "trials" / f"{task.name}-mockup", threads, bar)
    return write_report([out], out / "report", videos=sizes[0].videos, cameras=camera)


def sizes_of(task: Scenario, size: str) -> Preset:
    """The preset of a task's base; on a desk three tasks of two arms share the time of one scenario."""
    found = preset(task, size)
    if size == "desk" and task.base == "dual_arm":
        return replace(found, phase2=256)
    return found


def _models(task: Scenario, sizes: Preset, out: Path, seed: int, threads: int, bar: Bar) -> Path:
    """The folder of a task's models: what is reused, and what is trained on data of the task, or else of its base."""
    base, folder = task.base or task.name, out / "models" / task.name
    shipped, reused = shipped_models(base), REUSED[base]
    for name in reused:
        stages.reused(shipped / name, folder / name)
    home = scenario(base) if "trust-sdf" in reused else task
    data, dynamics, trust = out / "data" / home.name, folder / "dynamics", folder / "trust-sdf"
    config = CollectConfig(2, sizes.phase2, seed, steps=sizes.steps2, obstacles_every=OBSTACLES_EVERY)
    recorded(home, config, data, threads, bar)
    if "trust-sdf" not in reused:
        stages.trust(home, data, dynamics, sizes.trust_sdf, trust, seed)
    stages.recovery(home, data, dynamics, trust, sizes.recovery_sdf, folder / "recovery-sdf", seed)
    return folder
