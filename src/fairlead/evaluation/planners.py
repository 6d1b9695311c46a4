"""The table of planners: each a name, how to build one and what it does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from fairlead.core import plugins
from fairlead.planning.middle import ToTheMiddle
from fairlead.planning.ompl import OmplRRT
from fairlead.planning.problem import Planner, SearchSettings
from fairlead.planning.relaxed import Relaxed
from fairlead.planning.rrt import BatchedRRT
from fairlead.planning.several import Several
from fairlead.planning.shorten import Shortened

MakePlanner = Callable[[SearchSettings], Planner]
"""Called with the limits of a planning attempt."""

SHORT, RELAXED, BEST = "rrt-middle-short", "rrt-middle-short-relaxed", "rrt-best"


@dataclass(frozen=True)
class NamedPlanner:
    """One row."""

    make: MakePlanner
    sentence: str


def _short(settings: SearchSettings) -> Planner:
    return Shortened(BatchedRRT(settings.scaled(0.8)), settings)


PLANNERS: dict[str, NamedPlanner] = {
    "rrt": NamedPlanner(BatchedRRT, "The paper's kinodynamic RRT, in batches."),
    "rrt-middle": NamedPlanner(
        lambda settings: ToTheMiddle(BatchedRRT(settings)), "The same, to the middle of the goal instead of its rim."
    ),
    "rrt-short": NamedPlanner(_short, "The same, its plans made shorter."),
    SHORT: NamedPlanner(lambda settings: ToTheMiddle(_short(settings)), "Shorter plans to the middle of the goal."),
    RELAXED: NamedPlanner(
        lambda settings: Relaxed(ToTheMiddle(_short(settings))),
        "These, with less trust where enough leads nowhere.",
    ),
    BEST: NamedPlanner(
        lambda settings: Relaxed(Several(ToTheMiddle(_short(settings)))),
        "These, the best of several: where planning is quick, as with --distilled.",
    ),
    "ompl": NamedPlanner(OmplRRT, "The RRT of the Open Motion Planning Library."),
}
"""Others come by entry points in `fairlead.planners`: a `MakePlanner`."""


def find_planner(name: str) -> MakePlanner:
    """What builds the planner of that name.

    Raises:
        UnknownNameError: neither a row nor installed.
    """
    make: MakePlanner = plugins.find("planner", name, {name: row.make for name, row in PLANNERS.items()})
    return make


def planner_sentences() -> dict[str, str]:
    """What each planner does: the rows of the table, then the installed ones."""
    installed = [name for name in plugins.names("planner", {}) if name not in PLANNERS]
    return {name: row.sentence for name, row in PLANNERS.items()} | dict.fromkeys(installed, "Installed.")
