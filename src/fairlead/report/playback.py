"""A trial as a sequence of views, one a video frame: planning (the tree grows), executing, recovering, the end."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Int

from fairlead.core.layout import StateLayout
from fairlead.core.traces import Trace, TracedAction, TracedPlan

FPS = 25
SPEED = 4.0
"""Simulated seconds shown in one second of video."""
_FIRST_PLANNING, _LATER_PLANNING, _END = 30, 10, 45
"""Frames for growing the first tree, for each later one, and for the outcome."""


@dataclass(frozen=True)
class Branches:
    """The tree of one plan: where the goal's points of the rope are in each node, and the trust in reaching it."""

    points: Float[np.ndarray, "node followed 3"]
    parents: Int[np.ndarray, " node"]
    trust: Float[np.ndarray, " node"]


@dataclass(frozen=True)
class Episode:
    """One planning attempt with its execution, or (`planned` false) the recovery action after one that was stuck.

    Where there is no plan to show, `tree` and `predicted` are None. `errors` [m] are those of the goal.
    """

    planned: bool
    tree: Branches | None
    predicted: Float[np.ndarray, "steps_and_one state"] | None
    trust: Float[np.ndarray, " steps"]
    executed: Float[np.ndarray, "done_and_one state"]
    errors: Float[np.ndarray, " done_and_one"]
    seconds: Float[np.ndarray, " done"]
    planning_s: float


@dataclass(frozen=True)
class Recording:
    """A whole trial, and what to say about it: its title, and how it ended as a word and as a sentence.

    `measured` says what the errors of its episodes are distances to.
    """

    title: str
    layout: StateLayout
    episodes: tuple[Episode, ...]
    outcome: str
    sentence: str
    measured: str = "to the goal"


@dataclass(frozen=True)
class View:
    """What one frame shows of a trial."""

    state: Float[np.ndarray, " state"]
    phase: str
    seconds: float
    error_m: float
    plans: int
    episode: int = 0
    grown: float = 0.0
    ghost: Float[np.ndarray, " state"] | None = None
    trust: float | None = None
    trail: tuple[Float[np.ndarray, " state"], ...] = field(default=())
    ended: bool = False


def recording(trace: Trace, title: str, points: tuple[int, ...]) -> Recording:
    """A trace as episodes; `points` are the rope points whose places make the drawn tree."""
    episodes: list[Episode] = []
    state, error, clock = trace.start, trace.start_error_m, 0.0
    for plan in trace.plans:
        done = [action for action in trace.actions if action.plan == plan.index]
        for part, recovering in (([a for a in done if not a.recovery], False), ([a for a in done if a.recovery], True)):
            if recovering and not part:
                continue
            found = None if recovering or not len(plan.states) else plan
            errors = np.array([error, *(action.error_m for action in part)])
            # What a recovery took to choose lies between the end of planning and the start of its action.
            decided_s = part[0].at_s - part[0].seconds if recovering else plan.at_s
            planning_s = decided_s - clock
            episodes.append(_episode(trace.layout, not recovering, found, part, state, errors, planning_s, points))
            state, error = part[-1].state if part else state, float(errors[-1])
            clock = part[-1].at_s if part else max(clock, plan.at_s)
    return Recording(title, trace.layout, tuple(episodes), trace.outcome.label, trace.outcome.sentence)


def _episode(
    layout: StateLayout,
    planned: bool,
    plan: TracedPlan | None,
    actions: list[TracedAction],
    state: Float[np.ndarray, " state"],
    errors: Float[np.ndarray, " done_and_one"],
    planning_s: float,
    points: tuple[int, ...],
) -> Episode:
    executed = np.stack([state, *(action.state for action in actions)])
    tree = predicted = None
    if plan is not None:
        places = layout.object_of(plan.tree.states)[:, points]
        tree = Branches(places, plan.tree.parents, plan.tree.trust)
        predicted = plan.states
    return Episode(
        planned,
        tree,
        predicted,
        np.zeros(0) if plan is None else plan.trust,
        executed,
        errors,
        np.array([action.seconds for action in actions]),
        max(0.0, planning_s),
    )


def as_predicted(recording: Recording, title: str) -> Recording:
    """The same trial, frame for frame, as its plans foretold it, each from the state in which it was made.

    Its errors are how far the farthest point is from where it was seen then [m]. What nobody foretells, recovery, is
    shown as it was.
    """
    layout, episodes = recording.layout, []
    for episode in recording.episodes:
        seen = episode.executed
        foretold = seen if episode.predicted is None else episode.predicted[: len(seen)]
        gaps = layout.object_of(foretold) - layout.object_of(seen)
        errors = np.linalg.norm(gaps, axis=-1).max(axis=-1)
        episodes.append(replace(episode, executed=foretold, errors=errors, predicted=None))
    worst = max((float(episode.errors.max()) for episode in episodes), default=0.0)
    sentence = f"Off by up to {100 * worst:.1f} cm at a point."
    return Recording(title, layout, tuple(episodes), recording.outcome, sentence, "off at the farthest point")


def views(recording: Recording) -> Iterator[View]:
    """The frames of a trial, in order. The last one repeats to leave time for reading the outcome."""
    seconds, plans, trail = 0.0, 0, ()
    view = None
    for index, episode in enumerate(recording.episodes):
        plans += episode.planned
        error = float(episode.errors[0])
        view = View(episode.executed[0], "planning", seconds, error, plans, index, trail=trail)
        if episode.planned and episode.tree is None:
            yield from [replace(view, phase="stuck")] * _LATER_PLANNING
        elif episode.tree is not None:
            count = _FIRST_PLANNING if index == 0 else _LATER_PLANNING
            for frame in range(count):
                grown = (frame + 1) / count
                yield replace(view, grown=grown, seconds=seconds + grown * episode.planning_s)
        seconds += episode.planning_s
        view = replace(view, seconds=seconds, grown=1.0)
        for shown in _executing(episode, view):
            view = shown
            yield view
        trail, seconds = view.trail, view.seconds
    if view is not None:
        yield from [replace(view, phase=recording.outcome, ended=True)] * _END


def _executing(episode: Episode, view: View) -> Iterator[View]:
    """The frames of the actions that were executed, with straight lines between the observed states."""
    phase = "executing" if episode.planned else "recovering"
    seconds, trail = view.seconds, view.trail
    for step, took in enumerate(episode.seconds):
        count = max(2, round(float(took) * FPS / SPEED))
        ghost = None if episode.predicted is None else episode.predicted[step + 1]
        trust = None if episode.predicted is None else float(episode.trust[step])
        for frame in range(1, count + 1):
            part = frame / count
            state = (1 - part) * episode.executed[step] + part * episode.executed[step + 1]
            now = seconds + part * float(took)
            error = float((1 - part) * episode.errors[step] + part * episode.errors[step + 1])
            view = replace(
                view, state=state, phase=phase, seconds=now, error_m=error, ghost=ghost, trust=trust,
                trail=(*trail, state),
            )  # fmt: skip
            yield view
        seconds, trail = view.seconds, view.trail
