"""`fairlead methods`."""

from __future__ import annotations

from dataclasses import dataclass

from fairlead.cli.output import show


@dataclass(frozen=True)
class Command:
    """Every name that `plan --method` and `evaluate --methods` take, installed checks too, and what it does."""

    json: bool = False
    """Print one JSON object."""

    def run(self) -> None:
        """Print it."""
        from fairlead.evaluation.methods import find_method, method_names

        show({name: find_method(name).sentence for name in method_names()}, self.json)
