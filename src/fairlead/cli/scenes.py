"""`fairlead scenes SCENARIO --count N --out FILE`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from fairlead.cli.output import progress_bar, show


@dataclass(frozen=True)
class Command:
    """Draw random scenes from a seed, in the format of the scene files."""

    scenario: Annotated[str, tyro.conf.Positional]
    """The world, for example `dragging`."""
    out: Path
    """The scene file."""
    count: int = 50
    """How many."""
    seed: int = 0
    """Of every random stream."""
    hard: bool = False
    """Hard ones. dragging: narrow gaps, wrapped and wedged starts, goals in and behind corners. dual_arm: ropes caught
    under hooks, draped over obstacles, led astray."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> None:
        """Draw, write, and print where."""
        from fairlead.scenarios.generate import generate
        from fairlead.scenarios.registry import scenario
        from fairlead.scenarios.scene_files import write_scenes

        world = scenario(self.scenario)
        kind = "hard" if self.hard else "random"
        with progress_bar(f"{self.scenario} scenes", self.count, "scenes") as advance:
            scenes = generate(world, kind, self.count, self.seed, advance)
        write_scenes(self.out, world.name, scenes, f"fairlead scenes {self.scenario}, {kind}, seed {self.seed}")
        show({"scenes": len(scenes), "file": str(self.out)}, self.json)
