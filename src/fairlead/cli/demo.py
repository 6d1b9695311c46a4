"""`fairlead demo`: the whole line at desk scale, into a folder of its own."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from fairlead.cli.reproduce import Command as Reproduce


@dataclass(frozen=True)
class Command:
    """Watch a rope being dragged by a planner that knows where its model can be trusted, and by one that does not."""

    out: Path = Path("runs/demo")
    """Folder of data, models, trials and report."""
    threads: int = os.cpu_count() or 1
    """Of the simulator and of training; as many processes run trials."""

    def run(self) -> None:
        """`fairlead reproduce dragging --preset desk`."""
        Reproduce("dragging", self.out, "desk", threads=self.threads).run()
