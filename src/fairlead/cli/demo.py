"""`fairlead demo`: both scenarios with the models that come with Fairlead, into a folder of its own."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from fairlead.cli.output import progress_bar, show
from fairlead.core.cores import cores


@dataclass(frozen=True)
class Command:
    """Watch a rope being dragged, and held by two arms, by a planner that knows where its model can be trusted, and by
    one that does not."""

    out: Path = Path("runs/demo")
    """Folder of trials and report."""
    workers: int = field(default_factory=cores)
    """Processes that run trials; no more than there are cores."""

    def run(self) -> None:
        """Plan, execute, report, and name the page and the videos."""
        from fairlead.reproduce.demo import demo

        page = demo(self.out, self.workers, progress_bar)
        videos = sorted((page.parent / "videos").glob("*.mp4"))
        show({"page": str(page), **{f"video {number}": str(path) for number, path in enumerate(videos, 1)}}, False)
