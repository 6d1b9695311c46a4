"""A robot of one's own: the `World` that a driver must be. Put yours in `FakeDriver`'s place and run this file.

The robot's hand holds a stick with a marker at its end, which a camera sees.
"""

from __future__ import annotations

import time
from typing import final

import numpy as np

from fairlead.core.contracts import check_world
from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome, Executed
from fairlead.core.roles import World


@final
class FakeDriver:
    """All that is asked of a driver. This one stops a tenth short of where it was told to go."""

    hand, _noise = np.array([0.0, 0.0, 0.4]), np.random.default_rng(0)

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
        return StateLayout(("hand",), points=1)

    def observe(self) -> np.ndarray:
        return self.state.copy()

    def execute(self, actions: np.ndarray) -> Executed:
        began, arrived = time.monotonic(), self.driver.move_to(actions[0], timeout_s=5.0)
        self.state = self.driver.see()[None]
        outcome = list(ActionOutcome).index(ActionOutcome.TARGET if arrived else ActionOutcome.TIMEOUT)
        return Executed(self.observe(), np.array([time.monotonic() - began]), np.array([outcome]))


if __name__ == "__main__":
    check_world(RobotWorld(FakeDriver()), np.array([[0.1, 0.0, 0.4]]))
    print("It keeps the contract: `fairlead.execution.trial.run_trial` can plan and act in it.")
