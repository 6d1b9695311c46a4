"""Environments as fields: occupancy and signed distance, from boxes, an occupancy grid or a point cloud."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Float32
from scipy import ndimage

from fairlead.core.roles import Environment
from fairlead.geometry.shapes import Box, box_distance

NOWHERE_M = 1e3
"""The distance [m] to obstacles where there are none: infinite distances would have no differences."""


def cell_centres(
    bounds: Float[np.ndarray, "2 3"], resolution: float
) -> tuple[Float[np.ndarray, "nx ny nz 3"], Float[np.ndarray, " 3"]]:
    """Centres [m] of the cubic cells that fill `bounds`, and the centre of the first."""
    counts = np.maximum(1, np.ceil((bounds[1] - bounds[0]) / resolution - 1e-6).astype(int))
    origin = bounds[0] + resolution / 2
    axes = [origin[i] + resolution * np.arange(int(counts[i]), dtype=float) for i in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1), origin


def look_up(
    table: Float[np.ndarray, "nx ny nz 4"],
    origin: Float[np.ndarray, " 3"],
    resolution: float,
    points: Float[np.ndarray, "*batch 3"],
) -> Float[np.ndarray, "*batch 4"]:
    """Distance and gradient at points: the nearest cell's, carried to the point by its gradient.

    d(x) = d(c) + grad d(c) . (x - c); points outside the table use the cell at its border.
    """
    cell = np.rint((points - origin) / resolution)
    shape = table.shape[:3]
    index = np.clip(np.nan_to_num(cell), 0, np.array(shape) - 1).astype(np.intp)
    flat = (index[..., 0] * shape[1] + index[..., 1]) * shape[2] + index[..., 2]
    found = table.reshape(-1, 4)[flat]
    found[..., 0] += ((points - (origin + resolution * index)) * found[..., 1:]).sum(-1)
    return found


def distance_table(distance: Float[np.ndarray, "nx ny nz"], resolution: float) -> Float[np.ndarray, "nx ny nz 4"]:
    """Distance [m] and its gradient in each cell, float32; an axis with one cell has gradient 0."""
    gradient = [
        np.gradient(distance, resolution, axis=axis) if distance.shape[axis] > 1 else np.zeros_like(distance)
        for axis in range(3)
    ]
    return np.stack([distance, *gradient], axis=-1).astype(np.float32)


@final
class BoxEnvironment(Environment):
    """An environment made of boxes.

    Distances and gradients are exact, and computed where they are asked for (docs/adr/0008).

    Args:
        boxes: obstacles and walls.
        bounds: region where states may lie, (2, 3) [m].
    """

    def __init__(self, boxes: Sequence[Box], bounds: Float[np.ndarray, "2 3"]) -> None:
        self.boxes = tuple(boxes)
        self._bounds = np.asarray(bounds, float)
        self._occupancy: dict[float, tuple[np.ndarray, np.ndarray]] = {}

    @property
    def bounds(self) -> Float[np.ndarray, "2 3"]:
        return self._bounds

    @cached_property
    def _rows(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """R^T, R^T c and size / 2 of every box, axis first: (3, box, 3), (3, box, 1) and (3, box, 1)."""
        turns = np.stack([box.rotation.T for box in self.boxes], axis=1)
        centres, sizes = np.array([[box.position, box.size] for box in self.boxes]).transpose(1, 2, 0)
        offsets = np.einsum("abx,xb->ab", turns, centres)
        return (
            turns.astype(np.float32),
            offsets[..., None].astype(np.float32),
            (sizes[..., None] / 2).astype(np.float32),
        )

    def signed_distance(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
        return box_distance(self.boxes, points)

    def distance_and_gradient(self, points: Float[np.ndarray, "*batch 3"]) -> Float32[np.ndarray, "*batch 4"]:
        """As `shapes.box_distance`, with the gradient of the nearest box: R n, where n is

        sign(l) max(q, 0) / |max(q, 0)| outside, and sign(l) on the axis of max_i q_i inside, l = R^T (x - c).
        """
        found = np.zeros((*points.shape[:-1], 4), np.float32)
        if not self.boxes:
            found[..., 0] = NOWHERE_M
            return found
        turns, offsets, halves = self._rows
        flat = points.reshape(-1, 3).astype(np.float32).T
        local = (turns.reshape(-1, 3) @ flat).reshape(3, len(self.boxes), -1) - offsets
        q = np.abs(local) - halves
        beyond = np.maximum(q, 0.0)
        outside = np.sqrt(beyond[0] * beyond[0] + beyond[1] * beyond[1] + beyond[2] * beyond[2])
        distance = outside + np.minimum(np.maximum(np.maximum(q[0], q[1]), q[2]), 0.0)
        box, point = distance.argmin(axis=0), np.arange(flat.shape[1])
        outside, beyond = outside[box, point], beyond[:, box, point]
        inward = (outside <= 0) & (np.arange(3)[:, None] == q[:, box, point].argmax(axis=0))
        normal = np.copysign(beyond / np.maximum(outside, 1e-12) + inward, local[:, box, point])
        rows = found.reshape(-1, 4)
        rows[:, 0] = distance[box, point]
        rows[:, 1:] = np.sum(turns[:, box] * normal[..., None], axis=0)
        return found

    def occupied(self, points: Float[np.ndarray, "*batch 3"]) -> Bool[np.ndarray, "*batch"]:
        return np.asarray(self.signed_distance(points) < 0)

    def occupancy(self, resolution: float) -> tuple[Bool[np.ndarray, "nx ny nz"], Float[np.ndarray, " 3"]]:
        if resolution not in self._occupancy:
            centres, origin = cell_centres(self._bounds, resolution)
            self._occupancy[resolution] = (self.occupied(centres), origin)
        return self._occupancy[resolution]


@final
class GridEnvironment(Environment):
    """An environment given as an occupancy grid, for maps that a robot has sensed.

    Args:
        grid: whether each cubic cell is occupied, (nx, ny, nz).
        origin: centre of the first cell [m].
        resolution: cell size [m].
    """

    def __init__(self, grid: Bool[np.ndarray, "nx ny nz"], origin: Float[np.ndarray, " 3"], resolution: float) -> None:
        self._grid, self._origin, self._resolution = grid, np.asarray(origin, float), resolution
        self._occupancy: dict[float, tuple[np.ndarray, np.ndarray]] = {}
        # Distances run between cell centres; half a cell brings the surface to the cells' faces.
        if grid.any():
            outside = np.asarray(ndimage.distance_transform_edt(~grid)) - 0.5
            inside = np.asarray(ndimage.distance_transform_edt(np.pad(grid, 1)))[1:-1, 1:-1, 1:-1] - 0.5
            distance = np.where(grid, -inside, outside) * resolution
        else:
            distance = np.full(grid.shape, NOWHERE_M)
        self._table = distance_table(distance, resolution)

    @classmethod
    def from_points(
        cls, points: Float[np.ndarray, "count 3"], bounds: Float[np.ndarray, "2 3"], resolution: float = 0.01
    ) -> GridEnvironment:
        """Mark the cell of each sensed point inside `bounds` [m] as occupied."""
        centres, origin = cell_centres(np.asarray(bounds, float), resolution)
        grid = np.zeros(centres.shape[:3], bool)
        index = np.rint((points - origin) / resolution).astype(int)
        inside = ((index >= 0) & (index < grid.shape)).all(axis=-1)
        grid[tuple(index[inside].T)] = True
        return cls(grid, origin, resolution)

    @property
    def bounds(self) -> Float[np.ndarray, "2 3"]:
        low = self._origin - self._resolution / 2
        return np.stack([low, low + self._resolution * np.array(self._grid.shape)])

    def signed_distance(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
        return self.distance_and_gradient(points)[..., 0]

    def distance_and_gradient(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 4"]:
        return look_up(self._table, self._origin, self._resolution, points)

    def occupied(self, points: Float[np.ndarray, "*batch 3"]) -> Bool[np.ndarray, "*batch"]:
        index = np.rint((points - self._origin) / self._resolution).astype(int)
        inside = ((index >= 0) & (index < self._grid.shape)).all(axis=-1)
        clipped = np.clip(index, 0, np.array(self._grid.shape) - 1)
        return np.asarray(inside & self._grid[clipped[..., 0], clipped[..., 1], clipped[..., 2]])

    def occupancy(self, resolution: float) -> tuple[Bool[np.ndarray, "nx ny nz"], Float[np.ndarray, " 3"]]:
        if resolution not in self._occupancy:
            centres, origin = cell_centres(self.bounds, resolution)
            self._occupancy[resolution] = (self.occupied(centres), origin)
        return self._occupancy[resolution]
