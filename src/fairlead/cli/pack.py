"""`fairlead pack MODELS --out DIR`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from fairlead.cli.output import show


@dataclass(frozen=True)
class Command:
    """Make trained models ready to travel: half the size where nothing is lost by it, each with its card."""

    models: Annotated[Path, tyro.conf.Positional]
    """Folder of the trained models."""
    out: Path
    """Folder of the packed ones; must be new."""
    scenes: Path | None = None
    """Scene file, where models are compared with themselves in half precision; by default the benchmark scenes that
    come with Fairlead."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> None:
        """Pack, and print what became of each model."""
        from fairlead.reproduce.pack import pack

        packed = pack(self.models, self.out, self.scenes)
        total = sum(of.bytes for of in packed.values()) / 1e6
        rows = {
            name: {"weights": "half" if of.halved else "single", "difference": f"{of.difference:.1e}"}
            for name, of in packed.items()
        }
        show({**rows, "MB": round(total, 1), "out": str(self.out)}, self.json)
