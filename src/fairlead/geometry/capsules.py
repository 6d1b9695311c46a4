"""Distances of capsules to boxes and to each other, for many rows at once.

A capsule is a segment {p + t d, 0 <= t <= 1} thickened by a radius. Vectors have their components first and the batch
last, and every formula is elementwise over it: a row's numbers do not depend on its batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from fairlead.geometry.shapes import Box

HALVINGS = 12
"""Of a segment when its nearest point to a box is sought: an error of at most L / 2^12 for length L."""
_FAR = 1e6


def dot(a: Float[np.ndarray, " xyz *batch"], b: Float[np.ndarray, " xyz *batch"]) -> Float[np.ndarray, "*batch"]:
    """Inner products, the same to the last bit in any batch."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def segment_to_box(
    start: Float[np.ndarray, "3 pair"], along: Float[np.ndarray, "3 pair"], half: Float[np.ndarray, "3 pair"]
) -> Float[np.ndarray, " pair"]:
    """Signed distance [m] from segments to boxes about the origin with half sides `half`.

    The signed distance to a convex body is convex along a line: t is found by halving, from the sign of the slope.
    """
    t, step = np.full(start.shape[1:], 0.5), 0.25
    for _ in range(HALVINGS):
        x = start + t * along
        q = np.abs(x) - half
        largest = q.max(axis=0)
        normal = np.where(largest > 0, np.maximum(q, 0.0), q >= largest) * np.sign(x)
        t -= step * np.sign(dot(normal, along))
        step /= 2
    q = np.abs(start + t * along) - half
    outside = np.maximum(q, 0.0)
    return np.sqrt(dot(outside, outside)) + np.minimum(q.max(axis=0), 0.0)


def segment_to_segment(
    p: Float[np.ndarray, "3 pair"],
    d: Float[np.ndarray, "3 pair"],
    q: Float[np.ndarray, "3 pair"],
    e: Float[np.ndarray, "3 pair"],
) -> Float[np.ndarray, " pair"]:
    """Distance [m] between segments {p + s d} and {q + t e}; either may be a point.

    The nearest points of the lines, then t clamped, then s for that t (Ericson, Real-Time Collision Detection, 5.1.9).
    """
    tiny = 1e-12
    r = p - q
    dd, ee, de, dr, er = dot(d, d) + tiny, dot(e, e) + tiny, dot(d, e), dot(d, r), dot(e, r)
    s = np.clip((de * er - dr * ee) / np.maximum(dd * ee - de * de, tiny * dd * ee), 0.0, 1.0)
    t = np.clip((de * s + er) / ee, 0.0, 1.0)
    s = np.clip((de * t - dr) / dd, 0.0, 1.0)
    gap = r + s * d - t * e
    return np.sqrt(dot(gap, gap))


@dataclass(frozen=True)
class BoxRows:
    """The boxes of each row as arrays; a row with fewer than the most has others far away."""

    turns: Float[np.ndarray, "3 3 box row"]
    centres: Float[np.ndarray, "3 box row"]
    halves: Float[np.ndarray, "3 box row"]

    @classmethod
    def of(cls, rows: Sequence[Sequence[Box]]) -> BoxRows:
        """Pack the boxes of each row; rows that share one sequence are packed once."""
        distinct = {id(row): row for row in rows}
        place = {key: i for i, key in enumerate(distinct)}
        table = np.zeros((len(distinct), max(map(len, distinct.values()), default=0), 15))
        table[..., 9:12] = _FAR
        for part, row in zip(table, distinct.values(), strict=True):
            part[: len(row)] = _numbers(tuple(row))
        packed = np.ascontiguousarray(table[[place[id(row)] for row in rows]].T)
        return cls(packed[:9].reshape(3, 3, *packed.shape[1:]), packed[9:12], packed[12:])


@lru_cache(maxsize=4096)
def _numbers(boxes: tuple[Box, ...]) -> Float[np.ndarray, "box 15"]:
    """Rotation, centre and half sides of each box."""
    if not boxes:
        return np.zeros((0, 15))
    turns = Rotation.from_quat([box.quaternion_xyzw for box in boxes]).as_matrix().reshape(-1, 9)
    centres, sizes = np.array([box.position for box in boxes]), np.array([box.size for box in boxes])
    return np.concatenate([turns, centres, sizes / 2], axis=1)


@dataclass(frozen=True)
class Capsules:
    """Capsules of each column, column w * R + r in row r of R; each belongs to a group (an arm)."""

    starts: Float[np.ndarray, "3 capsule column"]
    along: Float[np.ndarray, "3 capsule column"]
    radii: Float[np.ndarray, " capsule"]
    groups: Int[np.ndarray, " capsule"]

    def clearance(self, boxes: BoxRows, horizon: float) -> Float[np.ndarray, " column"]:
        """Least distance [m] to a box or to a capsule of another group; `horizon` where all are farther."""
        least = np.full(self.starts.shape[-1], horizon)
        middles = self.starts + self.along / 2
        spheres = np.sqrt(dot(self.along, self.along)).max(axis=-1, initial=0.0) / 2 + self.radii
        self._to_boxes(least, middles, spheres + horizon, boxes, horizon)
        self._to_others(least, middles, spheres, horizon)
        return least

    def _to_boxes(
        self,
        least: Float[np.ndarray, " column"],
        middles: Float[np.ndarray, "3 capsule column"],
        spheres: Float[np.ndarray, " capsule"],
        boxes: BoxRows,
        horizon: float,
    ) -> None:
        """Spheres about capsule and box are compared first, then their extents along the axes of the box."""
        rows = boxes.centres.shape[-1]
        away = middles.reshape(3, len(spheres), 1, len(least) // max(rows, 1), rows) - boxes.centres[:, None, :, None]
        bound = spheres[:, None, None] + np.sqrt(dot(boxes.halves, boxes.halves))
        capsule, box, w, row = np.nonzero(dot(away, away) < (bound**2)[:, :, None])
        column = w * rows + row
        turns, half = boxes.turns[:, :, box, row], boxes.halves[:, box, row]
        p = _turn_back(turns, self.starts[:, capsule, column] - boxes.centres[:, box, row])
        d = _turn_back(turns, self.along[:, capsule, column])
        gap = (np.maximum(np.minimum(p, p + d), -np.maximum(p, p + d)) - half).max(axis=0)
        near = np.nonzero(gap < self.radii[capsule] + horizon)[0]
        distance = segment_to_box(p[:, near], d[:, near], half[:, near]) - self.radii[capsule[near]]
        np.minimum.at(least, column[near], distance)

    def _to_others(
        self,
        least: Float[np.ndarray, " column"],
        middles: Float[np.ndarray, "3 capsule column"],
        spheres: Float[np.ndarray, " capsule"],
        horizon: float,
    ) -> None:
        one, other = np.nonzero(self.groups[:, None] < self.groups)
        gap = middles[:, one] - middles[:, other]
        bound = spheres[one] + spheres[other] + horizon
        pair, column = np.nonzero(dot(gap, gap) < (bound**2)[:, None])
        i, j = one[pair], other[pair]
        distance = segment_to_segment(
            self.starts[:, i, column], self.along[:, i, column], self.starts[:, j, column], self.along[:, j, column]
        )
        np.minimum.at(least, column, distance - self.radii[i] - self.radii[j])


def _turn_back(turns: Float[np.ndarray, "3 3 pair"], vectors: Float[np.ndarray, "3 pair"]) -> np.ndarray:
    """R^T v."""
    return turns[0] * vectors[0] + turns[1] * vectors[1] + turns[2] * vectors[2]
