"""A robot of one's own: the `World` that a driver must be, and a trial on it. Put yours in `FakeDriver`'s place.

The robot's hand holds a stick with a marker at its end, which a camera sees; the marker is to go around a post.
"""

from __future__ import annotations

import time
from functools import partial
from typing import final

import numpy as np

from fairlead.core.budget import Budget
from fairlead.core.contracts import check_world
from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome, Executed, Prediction
from fairlead.core.roles import Dynamics, Environment, TransitionCheck, World
from fairlead.execution.trial import Protocol, Task, TrialResult, run_trial
from fairlead.geometry.fields import BoxEnvironment
from fairlead.geometry.goals import point_goal
from fairlead.geometry.motion import RandomDisplacement
from fairlead.geometry.shapes import Box
from fairlead.planning.checks import CollisionCheck
from fairlead.planning.problem import Problem
from fairlead.planning.recovery import NoRecovery
from fairlead.planning.rrt import BatchedRRT

LAYOUT = StateLayout(("hand",), points=1)
LOW, HIGH = (-0.5, -0.5, 0.0), (0.5, 0.5, 0.6)
"""The workspace: nothing is planned to leave it [m]."""
POST = BoxEnvironment([Box((0.1, 0.4, 0.3), (0.2, 0.0, 0.15))], np.array([LOW, HIGH]))
MOVES = RandomDisplacement(LAYOUT, 0.15, LOW, HIGH, planar=False)


@final
class FakeDriver:
    """All that is asked of a driver. This one stops a tenth short of where it was told to go."""

    def __init__(self) -> None:
        self.hand, self._noise = np.array([0.0, 0.0, 0.4]), np.random.default_rng(0)

    def move_to(self, target: np.ndarray, timeout_s: float) -> bool:
        """Move, wait until all is at rest, and say whether the hand arrived in time."""
        self.hand = self.hand + 0.9 * (target - self.hand)
        return timeout_s > 0

    def see(self) -> np.ndarray:
        """Where hand and marker are [m]: like any camera, never twice quite the same."""
        return np.concatenate([self.hand, self.hand - (0.0, 0.0, 0.2)]) + self._noise.normal(0, 0.001, 6)


@final
class RobotWorld(World):
    """A batch of one robot. What was seen at rest stays its state until it moves again."""

    def __init__(self, driver: FakeDriver) -> None:
        self.driver, self.state = driver, driver.see()[None]

    @property
    def layout(self) -> StateLayout:
        return LAYOUT

    def observe(self) -> np.ndarray:
        return self.state.copy()

    def execute(self, actions: np.ndarray) -> Executed:
        began, arrived = time.monotonic(), self.driver.move_to(actions[0], timeout_s=5.0)
        self.state = self.driver.see()[None]
        outcome = list(ActionOutcome).index(ActionOutcome.TARGET if arrived else ActionOutcome.TIMEOUT)
        return Executed(self.observe(), np.array([time.monotonic() - began]), np.array([outcome]))


@final
class Carried(Dynamics):
    """The marker moves as the hand does. `own_data.py` learns a model in its place."""

    layout = LAYOUT

    def predict(self, environment: Environment, states: np.ndarray, actions: np.ndarray) -> Prediction:
        return Prediction(states + np.tile(actions - states[:, :3], 2), np.zeros(len(states)))


def trial(world: World, dynamics: Dynamics, check: TransitionCheck) -> TrialResult:
    """Plan and execute, again and again, until the marker is at its goal or the minute is over."""
    goal = point_goal(LAYOUT, "tail", (0.4, 0.0, 0.2), 0.05)
    problem = Problem(POST, goal, dynamics, check, MOVES)
    task = Task(POST, goal, partial(BatchedRRT().plan, problem), NoRecovery())
    return run_trial(world, task, Budget(seconds=60), Protocol.FAIR, seed=0)


if __name__ == "__main__":
    check_world(RobotWorld(FakeDriver()), np.array([[0.1, 0.0, 0.4]]))
    result = trial(RobotWorld(FakeDriver()), Carried(), CollisionCheck(LAYOUT, 0.01))
    print(f"It keeps the contract. A trial: {result.outcome.label}, {result.error_m:.3f} m from the goal's middle, "
          f"{result.actions} actions.")  # fmt: skip
