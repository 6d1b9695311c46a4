"""The movie of both scenarios: trials of the models that come with the package, chosen by how they ended."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from fairlead.core.budget import Budget
from fairlead.report.movie import Card, Take, recoveries, takes, write_movie
from fairlead.report.sources import TrialSet
from fairlead.reproduce.cameras import camera
from fairlead.reproduce.demo import METHODS, try_methods
from fairlead.reproduce.trials import Bar

SCENES, BUDGET = 8, Budget(seconds=40)
OPENING = Card(
    "Fairlead",
    (
        "Planning with a learned model of a rope, and knowing where that model can be trusted.",
        "",
        "One network has learned how a rope moves where nothing is in its way.",
        "Another has learned where the first one is right.",
        "The planner goes only through what is trusted.",
    ),
    6.0,
)
TOLD = {
    "dragging": Card(
        "Dragging",
        (
            "A gripper pulls one end of a rope; the other end must come to the green circle.",
            "Left: the model is trusted only where it should be. Right: everywhere.",
            "Black: the rope. Amber: what the model predicts.",
            "The planner's tree is blue where trust is high, orange where it is low.",
        ),
    ),
    "dual_arm": Card(
        "Two arms",
        (
            "Two arms hold a rope; its midpoint must come to the green ball.",
            "Hooks and boxes are in the way, and the model has never seen any.",
            "Left: the model is trusted only where it should be. Right: everywhere.",
        ),
    ),
}
RECOVERY = (
    "Where nothing that it could do next is trusted,",
    "the planner is stuck.",
    "",
    "A third network has learned which motion leads",
    "back to where the model can be trusted.",
    "",
    "Then it plans again. Amber: the prediction;",
    "black: what happens.",
)


def movie(path: Path, out: Path, workers: int, bar: Bar) -> None:
    """Run the trials, kept in the folder `out`, and write the movie. Run again, it goes on where it stopped.

    Raises:
        FairleadError: no models come with the package, or `out` holds something else.
    """
    parts: list[Card | Take] = [OPENING]
    counts: list[str] = []
    for scenario in METHODS:
        trials = TrialSet(try_methods(scenario, SCENES, BUDGET, out / scenario, workers, bar))
        parts += [TOLD[scenario], *takes(trials, 3), *recoveries(trials, RECOVERY)]
        counts += [
            f"{scenario.replace('_', ' ')}, {name}: {sum(row['success'] for row in rows)} of {len(rows)} reach the goal"
            for name, rows in trials.rows_of.items()
        ]
    lines = (f"All trials of this movie, {SCENES} benchmark scenes of each, {BUDGET.seconds:g} s a trial:", "", *counts)
    parts.append(Card("What happened", lines))
    with bar("movie", len(parts), "parts") as advance:
        write_movie(path, parts, partial(camera, shadows=True), lambda part: advance(1))
