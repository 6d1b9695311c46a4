"""A robot's driver as a world: the example keeps the contract, and a trial runs on it."""

from __future__ import annotations

import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import final

import numpy as np
import pytest

from fairlead.core.budget import Budget
from fairlead.core.contracts import check_world
from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome, Prediction
from fairlead.core.roles import Dynamics, Environment
from fairlead.execution.trial import Protocol, Task, run_trial
from fairlead.geometry.fields import BoxEnvironment
from fairlead.geometry.goals import point_goal
from fairlead.geometry.motion import RandomDisplacement
from fairlead.geometry.shapes import Box
from fairlead.planning.checks import CollisionCheck
from fairlead.planning.problem import Problem
from fairlead.planning.recovery import NoRecovery
from fairlead.planning.rrt import BatchedRRT

EXAMPLES = Path(__file__).parents[1] / "examples"
LAYOUT = StateLayout(("hand",), points=1)


@final
class Carried(Dynamics):
    """The marker moves as the hand does."""

    layout = LAYOUT

    def predict(self, environment: Environment, states: np.ndarray, actions: np.ndarray) -> Prediction:
        return Prediction(states + np.tile(actions - states[:, :3], 2), np.zeros(len(states)))


@pytest.fixture
def _examples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES))


def test_the_example_runs() -> None:
    found = subprocess.run([sys.executable, EXAMPLES / "own_robot.py"], capture_output=True, text=True, check=True)
    assert "keeps the contract" in found.stdout


@pytest.mark.usefixtures("_examples")
def test_a_late_driver_is_told_from_one_that_arrived(monkeypatch: pytest.MonkeyPatch) -> None:
    from own_robot import FakeDriver, RobotWorld

    action = np.array([[0.1, 0.0, 0.4]])
    for arrives, wanted in ((True, ActionOutcome.TARGET), (False, ActionOutcome.TIMEOUT)):
        driver = FakeDriver()
        monkeypatch.setattr(driver, "move_to", lambda target, timeout_s, arrives=arrives: arrives)
        world = RobotWorld(driver)
        check_world(world, action)
        assert tuple(ActionOutcome)[world.execute(action).outcomes[0]] is wanted


@pytest.mark.usefixtures("_examples")
def test_a_trial_brings_the_marker_around_a_post_to_its_goal() -> None:
    from own_robot import FakeDriver, RobotWorld

    low, high = (-0.5, -0.5, 0.0), (0.5, 0.5, 0.6)
    environment = BoxEnvironment([Box((0.1, 0.4, 0.3), (0.2, 0.0, 0.15))], np.array([low, high]))
    goal = point_goal(LAYOUT, "tail", (0.4, 0.0, 0.2), 0.05)
    sampler = RandomDisplacement(LAYOUT, 0.15, low, high, planar=False)
    problem = Problem(environment, goal, Carried(), CollisionCheck(LAYOUT, 0.01), sampler)
    task = Task(environment, goal, partial(BatchedRRT().plan, problem), NoRecovery())
    world = RobotWorld(FakeDriver())
    result = run_trial(world, task, Budget(extensions=60_000), Protocol.FAIR, seed=0)
    assert result.success
    assert result.actions > 1
    assert goal.reached(world.observe())[0]
