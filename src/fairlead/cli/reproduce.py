"""`fairlead reproduce SCENARIO|real_tasks --preset smoke|desk|paper|evidence --out DIR`."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

from fairlead.cli.output import progress_bar, show
from fairlead.core.cores import cores


@dataclass(frozen=True)
class Command:
    """Collect, train, try every method and report. Interrupt it at will: the same command goes on where it stopped."""

    scenario: Annotated[str, tyro.conf.Positional]
    """The world, for example `dragging`; or `real_tasks`: all four of the paper's mock-ups."""
    out: Path
    """Folder of data, models, trials and report."""
    preset: str = "desk"
    """smoke (a minute), desk (on two cores 15 to 30 minutes, dual_arm 30 to 60; real_tasks, whose trials are many,
    about an hour), paper (the paper's data sizes, every method; one to four hours, dual_arm six or more), evidence (as
    paper, tried in every way, and on where paper ended; a day)."""
    sensitivity: bool = False
    """Train and try trust at other thresholds too (Fig. S2), as evidence does; not of real_tasks."""
    seed: int = 0
    """Of data and training; the trials' seeds are the preset's."""
    threads: int = field(default_factory=cores)
    """Of the simulator and of training; as many processes run trials."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> None:
        """Run what is missing, and name the page."""
        from fairlead.core import plugins
        from fairlead.core.errors import FairleadError, UnknownNameError
        from fairlead.reproduce.line import reproduce
        from fairlead.reproduce.presets import SensitivityConfig, preset
        from fairlead.reproduce.tasks import REAL_TASKS, reproduce_tasks
        from fairlead.scenarios.registry import SCENARIOS, scenario

        stated = self.out, self.seed, self.threads, progress_bar
        if self.scenario == REAL_TASKS:
            if self.sensitivity:
                raise FairleadError(f"--sensitivity means nothing to {REAL_TASKS}")
            page = reproduce_tasks(self.preset, *stated)
        else:
            worlds = plugins.names("scenario", SCENARIOS)
            if self.scenario not in worlds:
                raise UnknownNameError("scenario", self.scenario, [*worlds, REAL_TASKS])
            world = scenario(self.scenario)
            sizes = preset(world, self.preset)
            if self.sensitivity:
                sizes = replace(sizes, sensitivity=sizes.sensitivity or SensitivityConfig())
            page = reproduce(world, sizes, *stated, partial(print, file=sys.stderr))
        videos = sorted((page.parent / "videos").glob("*.mp4"))
        show({"page": str(page), **({"video": str(videos[0])} if videos else {})}, self.json)
