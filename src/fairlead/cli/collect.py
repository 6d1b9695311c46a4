"""`fairlead collect SCENARIO --phase 1|2 --out DIR`."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import tyro

from fairlead.cli.output import progress_bar, show
from fairlead.core.cores import cores


@dataclass(frozen=True)
class Command:
    """Record trajectories. Interrupt it at will: the same command goes on where it stopped, to the same bytes."""

    scenario: Annotated[str, tyro.conf.Positional]
    """The world, for example `dragging`."""
    phase: int
    """1: without obstacles, for dynamics. 2: among obstacles, for trust and recovery."""
    out: Path
    """Folder of the dataset."""
    trajectories: int | None = None
    """How many; the paper's number by default."""
    steps: int = 0
    """Actions in a trajectory; 0 for the paper's."""
    lanes: int = 64
    """Chains of trajectories that run side by side; at least eight for all three splits."""
    obstacles_every: int = 8
    """Phase 2: the obstacles move after so many trajectories of a lane. Fewer give more scenes to learn from."""
    seed: int = 0
    """Of every random stream."""
    threads: int = field(default_factory=cores)
    """Of the simulator; they do not change a byte."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> None:
        """Collect, with a progress bar, and print what was recorded."""
        from fairlead.data.collect import CollectConfig, collect
        from fairlead.data.verify import info
        from fairlead.scenarios.registry import scenario

        world = scenario(self.scenario)
        config = CollectConfig(self.phase, 1, self.seed, self.lanes, self.steps, self.obstacles_every)
        count = world.paper_data[self.phase - 1][0] if self.trajectories is None else self.trajectories
        config = replace(config, trajectories=count)
        total = count * config.resolved(world)["steps"]
        with progress_bar(f"{self.scenario} phase {self.phase}", total, "transitions") as advance:
            collect(world, config, self.out, self.threads, advance)
        show(info(self.out), self.json)
