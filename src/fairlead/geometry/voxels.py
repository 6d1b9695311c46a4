"""The environment and a state as a local, multichannel voxel grid (paper, Fig. 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from fairlead.core.errors import FairleadError
from fairlead.core.layout import StateLayout
from fairlead.core.roles import Environment
from fairlead.geometry.frames import local_origin


@dataclass(frozen=True)
class Occupancy:
    """The occupancy grids of several environments on the same cells, with a border of free cells.

    grids[e] belongs to environment e; `origin` is the centre of the first cell inside the border [m].
    """

    grids: Bool[np.ndarray, "environment nx ny nz"]
    origin: Float[np.ndarray, " 3"]

    @classmethod
    def of(cls, environments: Sequence[Environment], resolution: float) -> Occupancy:
        """Occupancy of environments that share their bounds, at that cell size [m]."""
        found = [environment.occupancy(resolution) for environment in environments]
        if any(grid.shape != found[0][0].shape or not np.allclose(origin, found[0][1]) for grid, origin in found):
            raise FairleadError("environments that are voxelised together must have the same bounds")
        return cls(np.pad(np.stack([grid for grid, _ in found]), ((0, 0), (1, 1), (1, 1), (1, 1))), found[0][1])


@dataclass(frozen=True)
class VoxelGrid:
    """A grid of cells about the local origin, snapped to the cells of the environment's occupancy.

    Args:
        shape: number of cells along x, y, z.
        resolution: cell size [m].
        sharpness: k of a state channel's value, the maximum over its points of exp(-k d^2) [1 / m^2].
    """

    shape: tuple[int, int, int]
    resolution: float
    sharpness: float = 1500.0

    def channels(self, layout: StateLayout) -> int:
        """Occupancy, rope, and one for each gripper."""
        return 2 + len(layout.grippers)

    def corner(
        self, layout: StateLayout, states: Float[np.ndarray, "batch state"], origin: Float[np.ndarray, " 3"]
    ) -> Int[np.ndarray, "batch 3"]:
        """Index, in the environment's cells, of the first cell of each local grid."""
        cell = np.nan_to_num((local_origin(layout, states) - origin) / self.resolution)
        centre = np.rint(np.clip(cell, -1e6, 1e6)).astype(np.intp)
        return centre - np.array(self.shape) // 2

    def draw(
        self,
        layout: StateLayout,
        occupancy: Occupancy,
        environment: Int[np.ndarray, " batch"],
        states: Float[np.ndarray, "batch state"],
    ) -> Float32[np.ndarray, "batch channel nx ny nz"]:
        """Occupancy about each state in its environment, then the rope and the grippers drawn as Gaussians.

        Outside the map is free.
        """
        corner = self.corner(layout, states, occupancy.origin)
        drawn = np.empty((len(states), self.channels(layout), *self.shape), np.float32)
        drawn[:, 0] = self._crop(occupancy.grids, environment, corner)
        low = occupancy.origin + self.resolution * corner
        self._paint(drawn[:, 1], layout.points_of(states) - low[:, None])
        for index in range(len(layout.grippers)):
            self._paint(drawn[:, 2 + index], layout.grippers_of(states)[:, index : index + 1] - low[:, None])
        return drawn

    def _crop(
        self,
        grids: Bool[np.ndarray, "environment nx ny nz"],
        environment: Int[np.ndarray, " batch"],
        corner: Int[np.ndarray, "batch 3"],
    ) -> Bool[np.ndarray, "batch cx cy cz"]:
        size = np.array(grids.shape[1:])
        x, y, z = (
            np.clip(corner[:, axis, None] + np.arange(self.shape[axis]) + 1, 0, size[axis] - 1) for axis in range(3)
        )
        row = (environment[:, None] * size[0] + x) * size[1]
        flat = ((row[:, :, None] + y[:, None, :]) * size[2])[..., None] + z[:, None, None, :]
        return grids.reshape(-1)[flat]

    def _paint(
        self, channel: Float32[np.ndarray, "batch nx ny nz"], points: Float[np.ndarray, "batch point 3"]
    ) -> None:
        """max_p exp(-k |c - p|^2) at each cell centre c: a product of one factor an axis, so cheap."""
        factors = [
            np.exp(-self.sharpness * (points[..., axis, None] - self.resolution * np.arange(cells)) ** 2).astype(
                np.float32
            )
            for axis, cells in enumerate(self.shape)
        ]
        channel[:] = 0.0
        value = np.empty_like(channel)
        for x, y, z in zip(*(np.moveaxis(factor, 1, 0) for factor in factors), strict=True):
            plane = (y[:, :, None] * z[:, None, :])[:, None]
            np.multiply(x[:, :, None, None], plane, out=value)
            np.maximum(channel, value, out=channel)
