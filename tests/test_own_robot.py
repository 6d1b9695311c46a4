"""A robot's driver as a world: the example keeps the contract, and a trial runs on it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fairlead.core.contracts import check_world
from fairlead.core.records import ActionOutcome, Transitions
from fairlead.learning.registry import load_check, load_dynamics
from fairlead.planning.checks import CollisionCheck

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture
def _examples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES))


def test_the_example_runs() -> None:
    found = subprocess.run([sys.executable, EXAMPLES / "own_robot.py"], capture_output=True, text=True, check=True)
    assert "keeps the contract. A trial: goal" in found.stdout


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
    from own_robot import LAYOUT, Carried, FakeDriver, RobotWorld, trial

    driver = FakeDriver()
    result = trial(RobotWorld(driver), Carried(), CollisionCheck(LAYOUT, 0.01))
    assert result.success
    assert result.actions > 1
    assert np.linalg.norm(driver.hand - (0.0, 0.0, 0.2) - (0.4, 0.0, 0.2)) < 0.06


@pytest.mark.usefixtures("_examples")
def test_what_was_learned_from_its_own_moves_leads_around_the_post(tmp_path: Path) -> None:
    from own_data import BumpingDriver, main
    from own_robot import POST

    assert main(tmp_path, trajectories=100).success
    check = load_check(tmp_path / "trust", "own-robot")
    hand = np.array([[0.1, 0.0, 0.4], [-0.2, 0.0, 0.4]])  # beside the post and far from it
    states = np.concatenate([hand, hand - (0.0, 0.0, 0.2)], axis=1)
    actions = hand + np.array([0.12, 0.0, 0.0])
    predicted = load_dynamics(tmp_path / "dynamics", "own-robot").predict(POST, states, actions)
    transitions = Transitions(states, actions, predicted.mean, predicted.spread)
    bumps, free = check.probability(POST, transitions, *(check.encode(POST, s) for s in (states, predicted.mean)))
    assert bumps < 0.5 < free
    arrived = []
    for place, target in zip(hand, actions, strict=True):
        driver = BumpingDriver(POST)
        driver.hand = place
        arrived.append(driver.move_to(target, timeout_s=1.0))
    assert arrived == [False, True]
