"""How far apart two states are, for a search tree: a sum of Euclidean distances between groups of coordinates.

One gripper (dragging): |gripper| + |object|. More grippers (dual arm): the sum over all points.
"""

from __future__ import annotations

from typing import final

import numpy as np
from jaxtyping import Float, Int

from fairlead.core.layout import StateLayout


def metric_groups(layout: StateLayout) -> tuple[int, ...]:
    """Number of coordinates in each group, in the order of the state vector."""
    if len(layout.grippers) == 1:
        return layout.parts
    return (3,) * (layout.state_size // 3)


@final
class Metric:
    """Distances between states in single precision, as matrix products: |x - y|^2 = |x|^2 + |y|^2 - 2 x.y."""

    def __init__(self, layout: StateLayout) -> None:
        self._ends = np.cumsum([0, *metric_groups(layout)])

    def squares(self, states: Float[np.ndarray, "batch state"]) -> Float[np.ndarray, "batch group"]:
        """|x|^2 of each group, kept with a node so that it is computed once."""
        return np.add.reduceat(states * states, self._ends[:-1], axis=1)

    def nearest(
        self,
        targets: Float[np.ndarray, "target state"],
        states: Float[np.ndarray, "node state"],
        squares: Float[np.ndarray, "node group"],
    ) -> Int[np.ndarray, " target"]:
        """Index of the state nearest to each target."""
        target_squares = self.squares(targets)
        distance = np.zeros((len(targets), len(states)), np.float32)
        for group, (low, high) in enumerate(zip(self._ends[:-1], self._ends[1:], strict=True)):
            square = targets[:, low:high] @ states[:, low:high].T
            square *= -2
            square += target_squares[:, group, None]
            square += squares[:, group]
            np.maximum(square, 0, out=square)
            distance += np.sqrt(square, out=square)
        return distance.argmin(axis=1)
