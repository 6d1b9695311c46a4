"""`fairlead planners`."""

from __future__ import annotations

from dataclasses import dataclass

from fairlead.cli.output import show


@dataclass(frozen=True)
class Command:
    """Every name that `plan` and `evaluate` take as --planner, installed ones too, and what it does."""

    json: bool = False
    """Print one JSON object."""

    def run(self) -> None:
        """Print it."""
        from fairlead.evaluation.planners import planner_sentences

        show(planner_sentences(), self.json)
