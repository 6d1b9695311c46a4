"""`fairlead movie --out movie.mp4`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from fairlead.cli.output import progress_bar, show
from fairlead.core.cores import cores


@dataclass(frozen=True)
class Command:
    """A movie of one to two minutes: both scenarios, with and without trust, made from the models that come with
    Fairlead."""

    out: Path = Path("movie.mp4")
    """The MP4. Its trials are kept beside it, in a folder of that name without the ending."""
    workers: int = field(default_factory=cores)
    """Processes that run trials; no more than there are cores."""

    def run(self) -> None:
        """Run the trials that are missing, and draw."""
        from fairlead.core.errors import FairleadError
        from fairlead.reproduce.movie import movie

        if self.out.suffix != ".mp4":
            raise FairleadError(f"{self.out}: a movie is a file NAME.mp4")
        movie(self.out, self.out.with_suffix(""), self.workers, progress_bar)
        show({"movie": str(self.out), "trials": str(self.out.with_suffix(""))}, False)
