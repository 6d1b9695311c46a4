"""Random actions: a random displacement, often repeated ("we repeat the previously sampled change ... with 80 %")."""

from __future__ import annotations

from typing import final

import numpy as np
from jaxtyping import Bool, Float

from fairlead.core.layout import StateLayout
from fairlead.core.roles import ActionSampler


@final
class RandomDisplacement(ActionSampler):
    """Moves each gripper by a displacement of uniform length in a uniform direction, kept inside bounds.

    Args:
        layout: how to read a state.
        reach: largest displacement [m].
        low, high: corners [m] of the region where gripper targets may lie.
        planar: directions in the horizontal plane (a heading) instead of pitch and yaw.
        repeat_probability: how often data collection repeats the previous displacement.
        apart: the largest distance between two grippers [m].
    """

    def __init__(
        self,
        layout: StateLayout,
        reach: float,
        low: tuple[float, ...],
        high: tuple[float, ...],
        planar: bool,
        repeat_probability: float = 0.8,
        apart: float = np.inf,
    ) -> None:
        self.layout, self.reach, self.planar = layout, reach, planar
        self.low, self.high = np.array(low), np.array(high)
        self.repeat_probability, self.apart = repeat_probability, apart

    def displacements(self, count: int, rng: np.random.Generator) -> Float[np.ndarray, "count gripper 3"]:
        """Independent random displacements [m] for each gripper."""
        shape = (count, len(self.layout.grippers))
        yaw = rng.uniform(-np.pi, np.pi, shape)
        pitch = np.zeros(shape) if self.planar else rng.uniform(-np.pi, np.pi, shape)
        length = rng.uniform(0.0, self.reach, shape)
        direction = np.stack([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)], axis=-1)
        return length[..., None] * direction

    def targets(
        self, states: Float[np.ndarray, "batch state"], displacements: Float[np.ndarray, "batch gripper 3"]
    ) -> Float[np.ndarray, "batch action"]:
        """Gripper positions plus displacements, moved to the nearest allowed position [m]."""
        moved = np.clip(self.layout.grippers_of(states) + displacements, self.low, self.high)
        if len(self.layout.grippers) == 2:
            middle = moved.mean(axis=1, keepdims=True)
            gap = np.linalg.norm(moved[:, 1:] - moved[:, :1], axis=-1, keepdims=True)
            moved = middle + (moved - middle) * np.minimum(1.0, self.apart / np.maximum(gap, 1e-9))
        return moved.reshape(len(states), self.layout.action_size)

    def propose(
        self, states: Float[np.ndarray, "batch state"], rng: np.random.Generator
    ) -> Float[np.ndarray, "batch action"]:
        return self.targets(states, self.displacements(len(states), rng))

    def repeat(
        self,
        states: Float[np.ndarray, "batch state"],
        actions: Float[np.ndarray, "batch action"],
        next_states: Float[np.ndarray, "batch state"],
    ) -> Float[np.ndarray, "batch action"]:
        wanted = self.layout.grippers_of(actions) - self.layout.grippers_of(states)
        return self.targets(next_states, wanted)

    def redraw(
        self,
        previous: Float[np.ndarray, "batch gripper 3"],
        keep: Bool[np.ndarray, " batch"],
        rng: np.random.Generator,
    ) -> Float[np.ndarray, "batch gripper 3"]:
        """The displacements of data collection: where `keep`, the previous one with `repeat_probability`."""
        fresh = self.displacements(len(previous), rng)
        repeated = keep & (rng.random(len(previous)) < self.repeat_probability)
        return np.where(repeated[:, None, None], previous, fresh)
