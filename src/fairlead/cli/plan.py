"""`fairlead plan SCENARIO --scene NAME --trace DIR --video out.mp4`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from fairlead.cli.output import show


@dataclass(frozen=True)
class Command:
    """Run one trial, keep its trace, and make a video of it."""

    scenario: Annotated[str, tyro.conf.Positional]
    """The world, for example `dragging`."""
    scene: str
    """Name of the scene."""
    trace: Path
    """Folder for the trace; must be new. It stays readable if you interrupt the trial."""
    scenes: Path | None = None
    """Scene file; by default the benchmark scenes that come with Fairlead."""
    models: Path | None = None
    """Folder of trained models; by default those that come with Fairlead."""
    method: str = "trust-sdf"
    """A row of the table of methods, see `fairlead methods`."""
    budget: str = "seconds=60"
    """seconds=N or extensions=N."""
    protocol: str = "fair"
    """paper or fair."""
    planner: str = "rrt"
    """A name, see `fairlead planners`; rrt is the paper's."""
    other: str | None = None
    """Execute in a world other than that of training, as `evaluate` does."""
    remember: bool = False
    """Keep away from actions that were cut short in this trial."""
    distilled: bool = False
    """Plan with the one network that was distilled from the ensemble: faster, and a little less exact. Full dynamics
    and the oracle stay as they are."""
    seed: int = 0
    """Of the trial."""
    video: Path | None = None
    """An MP4 of the trial."""
    export: Path | None = None
    """The first plan, as predicted, for a robot's own player: a .csv or .json of times, gripper positions and, where
    there are arms, joint angles."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> None:
        """Plan, execute, print how it ended."""
        from fairlead.core.budget import Budget
        from fairlead.core.errors import ArtifactError, FairleadError
        from fairlead.core.traces import read_trace
        from fairlead.evaluation.bench import Bench, Job, TrialsConfig
        from fairlead.evaluation.shipped import benchmark_scenes, shipped_models
        from fairlead.execution.trial import Protocol
        from fairlead.learning.registry import use_threads
        from fairlead.report.video import write_video
        from fairlead.report.videos import panels
        from fairlead.reproduce.cameras import camera
        from fairlead.scenarios.other_world import Differences
        from fairlead.scenarios.trajectory import planned, require_format

        if self.trace.exists():
            raise ArtifactError(self.trace, "exists already; a trace needs a new folder")
        if self.video is not None and self.video.suffix != ".mp4":
            raise FairleadError(f"{self.video}: a video is a file NAME.mp4")
        if self.export is not None:
            require_format(self.export)
        use_threads(1)  # as in the processes of `evaluate`, whose trials it repeats
        budget, protocol = Budget.parse(self.budget), Protocol.of(self.protocol)
        models = self.models or shipped_models(self.scenario)
        scenes = self.scenes or benchmark_scenes(self.scenario)
        config = TrialsConfig(self.scenario, models, scenes, (self.method,), budget, protocol, self.planner,
                              differences=None if self.other is None else Differences.parse(self.other),
                              remember=self.remember, distilled=self.distilled)  # fmt: skip
        bench = Bench(config)
        scene = bench.scenes.scene(self.scene)
        row = bench.run(Job(self.method, scene.name, self.seed, self.trace))
        if self.video is not None:
            seen = {"scenario": self.scenario, "differences": self.other}
            with panels(seen, scene.written(), {self.method: self.trace}, camera) as single:
                write_video(self.video, single)
            row["video"] = str(self.video)
        if self.export is not None:
            try:
                exported = planned(bench.models.scenario, scene, read_trace(self.trace))
            except FairleadError as error:  # the trial's result is worth showing all the same
                row["export"] = f"none: {error}"
            else:
                exported.write(self.export)
                row |= {"export": str(self.export), "exported_plan": exported.about["outcome"]}
        show(row | {"trace": str(self.trace)}, self.json)
