"""`fairlead evaluate SCENARIO --methods NAME,... --out DIR`."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from fairlead.cli.output import progress_bar, show
from fairlead.core.cores import cores


@dataclass(frozen=True)
class Command:
    """Try methods on scenes. Interrupt it at will: the same command goes on with the trials that are missing."""

    scenario: Annotated[str, tyro.conf.Positional]
    """The world, for example `dragging`."""
    out: Path
    """Folder of the trials."""
    scenes: Path | None = None
    """Scene file; by default the benchmark scenes that come with Fairlead."""
    models: Path | None = None
    """Folder of trained models; by default those that come with Fairlead."""
    methods: str = "trust-sdf,accept-all"
    """Names, separated by commas, see `fairlead methods`."""
    reference: str | None = None
    """The method that is compared with each of the others. By default the one stated for these trials before, else the
    first in the table of methods."""
    budget: str = "seconds=180"
    """Of each trial: seconds=N, or extensions=N, which makes the trials reproducible to the bit."""
    protocol: str = "fair"
    """paper: a trial that is stuck without recovery ends; fair: it plans again, 100 times from one state at most."""
    other: str | None = None
    """Execute in a world other than that of training: mockup, or differences such as friction=0.5,mass=2."""
    planner: str = "rrt"
    """A name, see `fairlead planners`; rrt is the paper's."""
    remember: bool = False
    """Keep away from actions that were cut short in the same trial."""
    distilled: bool = False
    """Plan with the one network that was distilled from the ensemble: faster, and a little less exact. Full dynamics
    and the oracle stay as they are."""
    seed: int = 0
    """The first seed of the trials."""
    seeds: int = 1
    """How many seeds, each on every scene."""
    limit: int | None = None
    """Only the first so many scenes."""
    traced: int = 5
    """Keep the traces of the first so many scenes, for videos."""
    workers: int = field(default_factory=cores)
    """Processes. With a budget in seconds, no more than there are cores."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> None:
        """Run the missing trials with a progress bar, and print each method's success."""
        from fairlead.core.budget import Budget
        from fairlead.core.errors import FairleadError
        from fairlead.evaluation.bench import TrialsConfig
        from fairlead.evaluation.shipped import benchmark_scenes, shipped_models
        from fairlead.evaluation.trials import Trials
        from fairlead.execution.trial import Protocol
        from fairlead.scenarios.other_world import Differences

        budget, most = Budget.parse(self.budget), cores()
        if self.seeds < 1:
            raise FairleadError(f"--seeds {self.seeds}: at least 1 is needed")
        if budget.seconds < math.inf and self.workers > most:
            raise FairleadError(f"--workers {self.workers}: timed trials take a core each; {most} here")
        config = TrialsConfig(
            scenario=self.scenario,
            models=self.models or shipped_models(self.scenario),
            scenes=self.scenes or benchmark_scenes(self.scenario),
            methods=tuple(name.strip() for name in self.methods.split(",")),
            budget=budget,
            protocol=Protocol.of(self.protocol),
            planner=self.planner,
            seeds=tuple(range(self.seed, self.seed + self.seeds)),
            limit=self.limit,
            traced=self.traced,
            reference=self.reference,
            differences=None if self.other is None else Differences.parse(self.other),
            remember=self.remember,
            distilled=self.distilled,
        )
        trials = Trials(config, self.out)
        with progress_bar(f"{self.scenario} {config.scenes.stem}", len(trials.missing), "trials") as advance:
            summary = trials.run(self.workers, lambda row: advance(1))
        if self.json:
            show({"out": str(self.out), **summary}, True)
            return
        found = {name: summary["methods"][name] for name in summary["order"]}
        rates = {name: f"{100 * of['success']['value']:.0f} % ({of['trials']} trials)" for name, of in found.items()}
        show({**rates, "reference": summary["reference"], "out": self.out}, False)
