"""`fairlead scenes SCENARIO --count N --out FILE`, or with `--scenes FILE --solved-by TRIALS ...`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from fairlead.cli.output import progress_bar, show


@dataclass(frozen=True)
class Command:
    """Draw random scenes from a seed, or keep those of a scene file that somebody solved."""

    scenario: Annotated[str, tyro.conf.Positional]
    """The world, for example `dragging`."""
    out: Path
    """The scene file."""
    count: int = 50
    """How many."""
    seed: int | None = None
    """Of every random stream; 0 by default."""
    hard: bool = False
    """Hard ones. dragging: narrow gaps, wrapped and wedged starts, goals in and behind corners. dual_arm: ropes caught
    under hooks, draped over obstacles, led astray."""
    scenes: Path | None = None
    """With --solved-by: the scene file whose first so many solved scenes are kept."""
    solved_by: tuple[Path, ...] = ()
    """Folders of trials on those scenes: a scene is kept where any trial in them succeeded."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> None:
        """Draw or choose, write, and print where."""
        from fairlead.core.errors import ArtifactError, FairleadError
        from fairlead.evaluation.solved import solved_scenes
        from fairlead.scenarios.generate import generate
        from fairlead.scenarios.registry import scenario
        from fairlead.scenarios.scene_files import write_scenes

        if (self.scenes is None) != (not self.solved_by):
            raise FairleadError("--scenes FILE and --solved-by TRIALS need each other")
        if self.scenes is not None and (self.hard or self.seed is not None):
            raise FairleadError("--hard and --seed mean nothing with --scenes: those scenes are drawn already")
        world = scenario(self.scenario)
        if self.out.exists():
            raise ArtifactError(self.out, "is there already; remove it, or choose another file")
        kind = "hard" if self.hard else "random"
        if self.scenes is not None:
            scenes, source = solved_scenes(world, self.scenes, self.solved_by, self.count)
        else:
            seed = self.seed or 0
            source = f"fairlead scenes {self.scenario}, {kind}, seed {seed}"
            with progress_bar(f"{self.scenario} scenes", self.count, "scenes") as advance:
                scenes = generate(world, kind, self.count, seed, advance)
        write_scenes(self.out, world.name, scenes, source)
        show({"scenes": len(scenes), "file": str(self.out)}, self.json)
