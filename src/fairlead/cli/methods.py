"""`fairlead methods`."""

from __future__ import annotations

from dataclasses import dataclass

from fairlead.cli.output import show


@dataclass(frozen=True)
class Command:
    """The table of methods: every name that `plan --method` and `evaluate --methods` take, and what it does."""

    json: bool = False
    """Print one JSON object."""

    def run(self) -> None:
        """Print it."""
        from fairlead.evaluation.methods import METHODS

        show({name: method.sentence for name, method in METHODS.items()}, self.json)
