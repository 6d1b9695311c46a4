"""A trial as a sequence of views, one a video frame: planning (the tree grows), executing, recovering, the end."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Int

FPS = 25
SPEED = 4.0
"""Simulated seconds shown in one second of video."""
_FIRST_PLANNING, _LATER_PLANNING, _END = 30, 10, 45
"""Frames for growing the first tree, for each later one, and for the outcome."""


@dataclass(frozen=True)
class Branches:
    """The tree of one plan: where the goal's point of the rope is in each node, and the trust in reaching it."""

    points: Float[np.ndarray, "node 2"]
    parents: Int[np.ndarray, " node"]
    trust: Float[np.ndarray, " node"]


@dataclass(frozen=True)
class Episode:
    """One plan with its execution, or one recovery action (then `tree` and `predicted` are None)."""

    tree: Branches | None
    predicted: Float[np.ndarray, "steps_and_one point 3"] | None
    trust: Float[np.ndarray, " steps"]
    executed: Float[np.ndarray, "done_and_one point 3"]
    grippers: Float[np.ndarray, "done_and_one gripper 3"]
    seconds: Float[np.ndarray, " done"]
    planning_s: float


@dataclass(frozen=True)
class Recording:
    """A whole trial, and what to say about it."""

    title: str
    episodes: tuple[Episode, ...]
    outcome: str
    sentence: str
    success: bool


@dataclass(frozen=True)
class View:
    """What one frame shows of a trial."""

    rope: Float[np.ndarray, "point 3"]
    grippers: Float[np.ndarray, "gripper 3"]
    phase: str
    seconds: float
    plans: int
    episode: int = 0
    grown: float = 0.0
    ghost: Float[np.ndarray, "point 3"] | None = None
    trust: float | None = None
    trail: tuple[Float[np.ndarray, "point 3"], ...] = field(default=())
    ended: bool = False


def views(recording: Recording) -> Iterator[View]:
    """The frames of a trial, in order. The last one repeats to leave time for reading the outcome."""
    seconds, plans, trail = 0.0, 0, ()
    view = None
    for index, episode in enumerate(recording.episodes):
        plans += episode.tree is not None
        view = View(episode.executed[0], episode.grippers[0], "planning", seconds, plans, index, trail=trail)
        if episode.tree is not None:
            count = _FIRST_PLANNING if index == 0 else _LATER_PLANNING
            for frame in range(count):
                grown = (frame + 1) / count
                yield replace(view, grown=grown, seconds=seconds + grown * episode.planning_s)
        seconds += episode.planning_s
        for shown in _executing(episode, replace(view, seconds=seconds, grown=1.0)):
            view = shown
            yield view
        trail, seconds = view.trail, view.seconds
    if view is not None:
        yield from [replace(view, phase=recording.outcome, ended=True)] * _END


def _executing(episode: Episode, view: View) -> Iterator[View]:
    """The frames of the actions that were executed, with straight lines between the observed states."""
    phase = "recovering" if episode.predicted is None else "executing"
    seconds, trail = view.seconds, view.trail
    for step, took in enumerate(episode.seconds):
        count = max(2, round(float(took) * FPS / SPEED))
        ghost = None if episode.predicted is None else episode.predicted[step + 1]
        trust = None if episode.predicted is None else float(episode.trust[step])
        for frame in range(1, count + 1):
            part = frame / count
            rope = (1 - part) * episode.executed[step] + part * episode.executed[step + 1]
            grippers = (1 - part) * episode.grippers[step] + part * episode.grippers[step + 1]
            now = seconds + part * float(took)
            view = replace(
                view, rope=rope, grippers=grippers, phase=phase, seconds=now, ghost=ghost, trust=trust,
                trail=(*trail, rope),
            )  # fmt: skip
            yield view
        seconds, trail = view.seconds, view.trail
