"""Obstacles as oriented boxes, and their exact signed distance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fairlead.core.reading import Reader, Vector


@dataclass(frozen=True)
class Box:
    """An oriented box: full side lengths `size` [m], centre `position` [m], unit quaternion (x, y, z, w)."""

    size: Vector
    position: Vector
    quaternion_xyzw: Vector = (0.0, 0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        for name, length in (("size", 3), ("position", 3), ("quaternion_xyzw", 4)):
            value = getattr(self, name)
            if len(value) != length or not np.isfinite(value).all():
                raise ValueError(f"{name}: {length} finite numbers are needed, got {list(value)}")
        if min(self.size) <= 0:
            raise ValueError(f"size: every side must be positive, got {list(self.size)}")
        if abs(np.linalg.norm(self.quaternion_xyzw) - 1) > 1e-3:
            raise ValueError(f"quaternion_xyzw: a unit quaternion is needed, got {list(self.quaternion_xyzw)}")

    @classmethod
    def read(cls, reader: Reader) -> Box:
        """A box as a file writes it; FileFormatError names a wrong field."""
        lengths = {"size": 3, "position": 3, "quaternion_xyzw": 4}
        fields = {key: reader.only(*lengths).vector(key, length) for key, length in lengths.items()}
        try:
            return cls(**fields)
        except ValueError as error:
            key, _, problem = str(error).partition(": ")
            raise reader.fail(key, problem) from None

    def moved(self, position: Sequence[float] | Float[np.ndarray, " 3"], yaw: float) -> Box:
        """The box turned by `yaw` [rad] about the vertical through the origin, then shifted by `position` [m]."""
        turn = Rotation.from_euler("z", yaw)
        centre = turn.apply(self.position) + np.asarray(position)
        quaternion = (turn * Rotation.from_quat(self.quaternion_xyzw)).as_quat()
        return Box(self.size, tuple(map(float, centre)), tuple(map(float, quaternion)))

    @cached_property
    def rotation(self) -> Float[np.ndarray, "3 3"]:
        """The matrix whose columns are the directions of the sides."""
        return Rotation.from_quat(self.quaternion_xyzw).as_matrix()

    def corners(self) -> Float[np.ndarray, "8 3"]:
        """The eight corners [m]."""
        signs = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1], indexing="ij"), -1).reshape(8, 3)
        return Rotation.from_quat(self.quaternion_xyzw).apply(signs * np.array(self.size) / 2) + self.position


@dataclass(frozen=True)
class Obstacle:
    """A named rigid obstacle made of boxes."""

    name: str
    boxes: tuple[Box, ...]

    def __post_init__(self) -> None:
        if not self.boxes:
            raise ValueError(f"obstacle '{self.name}' has no boxes")

    def moved(self, position: Sequence[float] | Float[np.ndarray, " 3"], yaw: float) -> Obstacle:
        """The obstacle turned by `yaw` about the vertical through the origin, then shifted."""
        return Obstacle(self.name, tuple(box.moved(position, yaw) for box in self.boxes))


def octagon(radius: float, height: float) -> tuple[Box, ...]:
    """An upright octagonal column about the origin, as four boxes: its sides lie `radius` [m] from its axis."""
    size = (2 * radius, 2 * radius * float(np.tan(np.pi / 8)), height)
    return tuple(Box(size, (0.0, 0.0, 0.0)).moved((0.0, 0.0, 0.0), float(yaw)) for yaw in np.arange(4) * np.pi / 4)


def box_distance(boxes: Sequence[Box], points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
    """Signed distance [m] to the union of boxes: exact outside, the nearest face of one box inside.

    With q = |R^T (x - c)| - size / 2:  d = |max(q, 0)| + min(max_i q_i, 0), least over the boxes.
    """
    distance = np.full(points.shape[:-1], np.inf)
    for box in boxes:
        q = np.abs((points - np.array(box.position)) @ box.rotation) - np.array(box.size) / 2
        outside = np.linalg.norm(np.maximum(q, 0.0), axis=-1)
        distance = np.minimum(distance, outside + np.minimum(q.max(axis=-1), 0.0))
    return np.asarray(distance)
