"""The state as named groups of points in R^3: grippers first, then the points of the object.

Paper, "State definition": s = [g_1, ..., g_Ng, x_1, ..., x_Nr], N_d = 3 (N_g + N_r).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class StateLayout:
    """Names the parts of a state vector.

    Args:
        grippers: name of each gripper, in the order of the state vector.
        points: number of object points N_r. Point 0 is the tail, the last one is at the (right) gripper.
    """

    grippers: tuple[str, ...]
    points: int

    def __post_init__(self) -> None:
        if not self.grippers or self.points < 1:
            raise ValueError("a state has at least one gripper and one object point")

    @property
    def state_size(self) -> int:
        """N_d, the length of a state vector."""
        return 3 * (len(self.grippers) + self.points)

    @property
    def action_size(self) -> int:
        """Length of an action vector: a target position [m] for each gripper."""
        return 3 * len(self.grippers)

    def grippers_of(self, states: Float[np.ndarray, "*batch state"]) -> Float[np.ndarray, "*batch gripper 3"]:
        """Gripper positions [m], a view where numpy allows one."""
        head = states[..., : self.action_size]
        return head.reshape(*head.shape[:-1], len(self.grippers), 3)

    def points_of(self, states: Float[np.ndarray, "*batch state"]) -> Float[np.ndarray, "*batch point 3"]:
        """Object points [m], a view where numpy allows one."""
        tail = states[..., self.action_size :]
        return tail.reshape(*tail.shape[:-1], self.points, 3)

    def join(
        self, grippers: Float[np.ndarray, "*batch gripper 3"], points: Float[np.ndarray, "*batch point 3"]
    ) -> Float[np.ndarray, "*batch state"]:
        """The inverse of `grippers_of` and `points_of`."""
        batch = points.shape[:-2]
        head, tail = grippers.reshape(*batch, self.action_size), points.reshape(*batch, 3 * self.points)
        return np.concatenate([head, tail], axis=-1)
