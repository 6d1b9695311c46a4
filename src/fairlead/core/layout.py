"""The state as named groups of points in R^3: grippers first, then the points of the object.

Paper, "State definition": s = [g_1, ..., g_Ng, x_1, ..., x_Nr], N_d = 3 (N_g + N_r). A gripper is whatever an action
moves; a robot that holds nothing (N_r = 0) is its own object.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fairlead.core.errors import UnknownNameError


@dataclass(frozen=True)
class StateLayout:
    """Names the parts of a state vector.

    Args:
        grippers: name of each gripper, in the order of the state vector.
        points: number of object points N_r. Point 0 is the tail, the last one is at the (right) gripper. 0 where the
            grippers hold nothing.
    """

    grippers: tuple[str, ...]
    points: int

    def __post_init__(self) -> None:
        if not self.grippers or self.points < 0:
            raise ValueError("a state has at least one gripper, and no less than 0 object points")

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

    @property
    def parts(self) -> tuple[int, ...]:
        """Lengths, in a state vector, of the grippers and of the object they hold, if they hold one."""
        return tuple(length for length in (self.action_size, 3 * self.points) if length)

    def object_of(self, states: Float[np.ndarray, "*batch state"]) -> Float[np.ndarray, "*batch point 3"]:
        """The points [m] that predictions are judged by: the object's, or the grippers' where they hold none."""
        return self.points_of(states) if self.points else self.grippers_of(states)

    def join(
        self, grippers: Float[np.ndarray, "*batch gripper 3"], points: Float[np.ndarray, "*batch point 3"]
    ) -> Float[np.ndarray, "*batch state"]:
        """The inverse of `grippers_of` and `points_of`."""
        batch = points.shape[:-2]
        head, tail = grippers.reshape(*batch, self.action_size), points.reshape(*batch, 3 * self.points)
        return np.concatenate([head, tail], axis=-1)

    def index(self, target: str | int) -> int:
        """Where a named point stands among all points of a state: a gripper, `tail`, `midpoint`, `head`, or a number.

        Numbers count the object's points from the tail on.

        Raises:
            UnknownNameError: there is no such point.
        """
        first = len(self.grippers)
        named: dict[str | int, int] = {name: i for i, name in enumerate(self.grippers)}
        if self.points:
            named |= {"tail": first, "midpoint": first + self.points // 2, "head": first + self.points - 1}
        if type(target) is int and 0 <= target < self.points:
            return first + target
        if target not in named:
            numbers = [f"0 to {self.points - 1}"] if self.points else []
            raise UnknownNameError("point", str(target), [*map(str, named), *numbers])
        return named[target]

    def held(self, index: int) -> int:
        """The point of `object_of` that goes with an index of `index`: itself, or the end that a gripper holds."""
        first = len(self.grippers)
        if not self.points:
            return index
        return index - first if index >= first else self.points - 1 if index == first - 1 else 0
