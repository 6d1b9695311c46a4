"""A toy world: a short chain that follows its gripper exactly, in a walled arena of 2 m. Pure numpy, no learning."""

from __future__ import annotations

from typing import final

import numpy as np

from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome, Executed, Plan, Prediction
from fairlead.core.roles import Dynamics, Environment, Goal, World
from fairlead.geometry.fields import BoxEnvironment
from fairlead.geometry.goals import PointsGoal, point_goal
from fairlead.geometry.motion import RandomDisplacement
from fairlead.geometry.shapes import Box
from fairlead.planning.checks import CollisionCheck
from fairlead.planning.problem import Planner, Problem

LAYOUT = StateLayout(("gripper",), 3)
LINK = 0.1
RADIUS = 0.02
SAMPLER = RandomDisplacement(LAYOUT, 0.15, (-0.95, -0.95, 0.02), (0.95, 0.95, 0.02), planar=True)
WALLS = tuple(
    Box((0.1, 2.1, 0.3) if x else (2.1, 0.1, 0.3), (x, y, 0.15)) for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1))
)
BAR = Box((0.1, 1.2, 0.3), (0.0, 0.0, 0.15))


def arena(*boxes: Box) -> BoxEnvironment:
    return BoxEnvironment([*WALLS, *boxes], np.array([[-0.95, -0.95, 0.0], [0.95, 0.95, 0.04]]))


def straight(x: float, y: float, heading: float = 0.0) -> np.ndarray:
    """A state with the gripper at (x, y) and the chain behind it."""
    along = np.array([np.cos(heading), np.sin(heading), 0.0])
    gripper = np.array([x, y, 0.02])
    points = gripper - LINK * np.array([3, 2, 1])[:, None] * along
    return LAYOUT.join(gripper[None], points)


def tail_goal(x: float, y: float, radius: float = 0.05) -> PointsGoal:
    return point_goal(LAYOUT, "tail", (x, y, 0.02), radius)


def follow(states: np.ndarray, grippers: np.ndarray) -> np.ndarray:
    """Each point is pulled to one link's length from the point before it."""
    points = LAYOUT.points_of(states).copy()
    ahead = grippers[:, 0]
    for i in reversed(range(LAYOUT.points)):
        back = points[:, i] - ahead
        points[:, i] = ahead + LINK * back / np.maximum(np.linalg.norm(back, axis=1, keepdims=True), 1e-9)
        ahead = points[:, i]
    return LAYOUT.join(grippers, points)


@final
class FreeChain(Dynamics):
    """What happens without obstacles, with a constant spread."""

    layout = LAYOUT

    def predict(self, environment: Environment, states: np.ndarray, actions: np.ndarray) -> Prediction:
        return Prediction(follow(states, actions.reshape(-1, 1, 3)), np.full(len(states), 0.01))


@final
class BrokenChain(Dynamics):
    """Predicts NaN to the right of `beyond` [m]."""

    layout = LAYOUT

    def __init__(self, beyond: float = 0.0) -> None:
        self.beyond = beyond

    def predict(self, environment: Environment, states: np.ndarray, actions: np.ndarray) -> Prediction:
        after = follow(states, actions.reshape(-1, 1, 3))
        after[after[:, 0] > self.beyond] = np.nan
        return Prediction(after, np.zeros(len(states)))


@final
class ToyWorld(World):
    """The chain among obstacles: a motion that would touch one stops the gripper where it is."""

    layout = LAYOUT

    def __init__(self, environment: Environment, states: np.ndarray, diverge_after: int | None = None) -> None:
        self.environment, self.states = environment, np.array(states, float)
        self.executed, self.diverge_after = 0, diverge_after

    def observe(self) -> np.ndarray:
        return self.states.copy()

    def execute(self, actions: np.ndarray) -> Executed:
        self.executed += 1
        outcomes = np.full(len(actions), ActionOutcome.TARGET.number)
        if self.diverge_after is not None and self.executed > self.diverge_after:
            outcomes[:] = ActionOutcome.DIVERGED.number
            return Executed(self.observe(), np.full(len(actions), 1.0), outcomes)
        after = follow(self.states, actions.reshape(-1, 1, 3))
        blocked = (self.environment.signed_distance(LAYOUT.points_of(after)) < RADIUS / 2).any(axis=1)
        outcomes[blocked] = ActionOutcome.TIMEOUT.number
        self.states = np.where(blocked[:, None], self.states, after)
        return Executed(self.observe(), np.full(len(actions), 1.0), outcomes)


def problem(environment: BoxEnvironment, goal: Goal, dynamics: Dynamics | None = None) -> Problem:
    return Problem(environment, goal, dynamics or FreeChain(), CollisionCheck(LAYOUT, RADIUS), SAMPLER)


@final
class Given(Planner):
    """Returns the plan it was given."""

    def __init__(self, found: Plan) -> None:
        self.found = found

    def plan(self, problem, start, meter, rng):
        return self.found
