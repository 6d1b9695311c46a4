"""A robot's driver as a world: the example keeps the contract, and a trial runs on it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fairlead.core.contracts import check_world
from fairlead.core.records import ActionOutcome

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
    from own_robot import FakeDriver, RobotWorld, trial

    driver = FakeDriver()
    result = trial(RobotWorld(driver))
    assert result.success
    assert result.actions > 1
    assert np.linalg.norm(driver.hand - (0.0, 0.0, 0.2) - (0.4, 0.0, 0.2)) < 0.06
