"""The simulator itself as the dynamics: the bound on what planning can solve, at the price of simulating every node."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np
from jaxtyping import Float

from fairlead.core.layout import StateLayout
from fairlead.core.records import Prediction
from fairlead.core.roles import Dynamics, Environment
from fairlead.geometry.shapes import Obstacle
from fairlead.scenarios.scenario import Scenario


@final
class SimulatorDynamics(Dynamics):
    """The true dynamics f of one scene. A transition that diverges is predicted as NaN, which every planner rejects.

    Args:
        scenario: where to simulate.
        obstacles: of the scene; the environment given to `predict` must be theirs.
        threads: for the simulator.
    """

    def __init__(self, scenario: Scenario, obstacles: Sequence[Obstacle], threads: int = 1) -> None:
        self._scenario, self._obstacles, self._threads = scenario, obstacles, threads

    @property
    def layout(self) -> StateLayout:
        return self._scenario.layout

    def predict(
        self,
        environment: Environment,
        states: Float[np.ndarray, "batch state"],
        actions: Float[np.ndarray, "batch action"],
    ) -> Prediction:
        world = self._scenario.simulate([self._obstacles] * len(states), states, self._threads)
        executed = world.execute(actions)
        mean = np.where(executed.diverged[:, None], np.nan, executed.states)
        return Prediction(mean, np.zeros(len(states)))
