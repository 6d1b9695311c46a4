"""Goals: where a part of the object must be."""

from __future__ import annotations

from typing import final

import numpy as np
from jaxtyping import Bool, Float

from fairlead.core.layout import StateLayout
from fairlead.core.roles import Goal


@final
class PointGoal(Goal):
    """One point of the rope at a place, within a radius.

    Args:
        layout: how to read a state.
        point: index of the rope point (0 is the tail).
        position: where it must be [m].
        radius: how near is near enough [m].
    """

    def __init__(self, layout: StateLayout, point: int, position: tuple[float, ...], radius: float) -> None:
        self.layout, self.point, self.radius = layout, point, radius
        self.position = np.array(position, float)

    def error(self, states: Float[np.ndarray, "*batch state"]) -> Float[np.ndarray, "*batch"]:
        return np.asarray(np.linalg.norm(self.layout.points_of(states)[..., self.point, :] - self.position, axis=-1))

    def reached(self, states: Float[np.ndarray, "*batch state"]) -> Bool[np.ndarray, "*batch"]:
        return np.asarray(self.error(states) < self.radius)

    def sample(
        self, states: Float[np.ndarray, "batch state"], rng: np.random.Generator
    ) -> Float[np.ndarray, "batch state"]:
        """Shift each state as a whole so that its point lies at the goal."""
        shift = self.position - self.layout.points_of(states)[:, self.point]
        return states + np.tile(shift, states.shape[1] // 3)
