"""`fairlead report DIR...`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from fairlead.cli.output import show


@dataclass(frozen=True)
class Command:
    """Tables, figures, videos and one self-contained HTML page from finished trials, models, data and evidence."""

    folders: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Where to look for them; folders below are searched, too."""
    out: Path = Path("report")
    """Folder of the report."""
    no_videos: bool = False
    """Leave the videos out."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> None:
        """Write the report and print where it is."""
        from fairlead.core.errors import FairleadError
        from fairlead.report.page import write_report
        from fairlead.reproduce.cameras import camera

        if not self.folders:
            raise FairleadError("report needs at least one folder of trials or models")
        show({"page": str(write_report(self.folders, self.out, videos=not self.no_videos, cameras=camera))}, self.json)
