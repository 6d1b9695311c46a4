"""`fairlead data info DIR` and `fairlead data verify DIR`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from fairlead.cli.output import show


@dataclass(frozen=True)
class Info:
    """What a dataset is: its configuration and counts."""

    folder: Annotated[Path, tyro.conf.Positional]
    """The dataset."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> None:
        """Print the configuration and the counts."""
        from fairlead.data.verify import info

        show(info(self.folder), self.json)


@dataclass(frozen=True)
class Verify:
    """Check hashes, columns, ranges and the length of the rope; name what is damaged."""

    folder: Annotated[Path, tyro.conf.Positional]
    """The dataset."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> None:
        """Verify, and print the counts."""
        from fairlead.data.verify import verify

        show({"verified": str(self.folder), **verify(self.folder)}, self.json)


Command = Annotated[Info, tyro.conf.subcommand("info")] | Annotated[Verify, tyro.conf.subcommand("verify")]
