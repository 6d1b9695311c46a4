"""The environment and a state as a local, multichannel voxel grid (paper, Fig. 5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Int
from torch import Tensor
from torch.nn.functional import threshold

from fairlead.core.errors import FairleadError
from fairlead.core.layout import StateLayout
from fairlead.core.roles import Environment
from fairlead.geometry.frames import local_origin
from fairlead.learning.device import CPU

_TIE = 1e-4
NOTHING = 1e-12
"""A smaller value of a state channel is 0: processors are slow with the very smallest numbers (docs/adr/0019)."""


@dataclass(frozen=True)
class Occupancy:
    """The occupancy grids of several environments on the same cells, with a border of free cells.

    grids[e] belongs to environment e; `origin` is the centre of the first cell inside the border [m]. Voxels are drawn
    on the device where the grids are.
    """

    grids: Bool[Tensor, "environment nx ny nz"]
    origin: Float[np.ndarray, " 3"]

    @classmethod
    def of(cls, environments: Sequence[Environment], resolution: float, device: torch.device = CPU) -> Occupancy:
        """Occupancy of environments that share their bounds, at that cell size [m]."""
        found = [environment.occupancy(resolution) for environment in environments]
        if any(grid.shape != found[0][0].shape or not np.allclose(origin, found[0][1]) for grid, origin in found):
            raise FairleadError("environments that are voxelised together must have the same bounds")
        grids = np.pad(np.stack([grid for grid, _ in found]), ((0, 0), (1, 1), (1, 1), (1, 1)))
        return cls(torch.from_numpy(grids).to(device), found[0][1])


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

    @classmethod
    def read(cls, values: Mapping[str, Any]) -> Self:
        """A grid as JSON gives it."""
        return cls(**{**values, "shape": tuple(values["shape"])})

    def channels(self, layout: StateLayout) -> int:
        """Occupancy, rope, and one for each gripper."""
        return 2 + len(layout.grippers)

    def corner(
        self, layout: StateLayout, states: Float[np.ndarray, "batch state"], origin: Float[np.ndarray, " 3"]
    ) -> Int[np.ndarray, "batch 3"]:
        """Index, in the environment's cells, of the first cell of each local grid.

        A state between two cells takes the lower one, in single as in double precision: ropes on a table all are.
        """
        cell = np.nan_to_num((local_origin(layout, states) - origin) / self.resolution)
        centre = np.ceil(np.clip(cell, -1e6, 1e6) - 0.5 - _TIE).astype(np.intp)
        return centre - np.array(self.shape) // 2

    def draw(
        self,
        layout: StateLayout,
        occupancy: Occupancy,
        environment: Int[np.ndarray, " batch"],
        states: Float[np.ndarray, "batch state"],
    ) -> Float32[Tensor, "batch channel nx ny nz"]:
        """Occupancy about each state in its environment, then the rope and the grippers drawn as Gaussians.

        Outside the map is free.
        """
        corner, device = self.corner(layout, states, occupancy.origin), occupancy.grids.device
        low = occupancy.origin + self.resolution * corner
        local = (states.reshape(len(states), -1, 3) - low[:, None]).astype(np.float32)
        scene, first, positions = (torch.from_numpy(x).to(device) for x in (environment, corner, local))
        drawn = torch.empty((len(states), self.channels(layout), *self.shape), device=device)
        drawn[:, 0] = self._crop(occupancy.grids, scene, first)
        grippers = len(layout.grippers)
        self._paint(drawn[:, 1], positions[:, grippers:])
        for index in range(grippers):
            self._paint(drawn[:, 2 + index], positions[:, index : index + 1])
        return drawn

    def _crop(
        self,
        grids: Bool[Tensor, "environment nx ny nz"],
        environment: Int[Tensor, " batch"],
        corner: Int[Tensor, "batch 3"],
    ) -> Bool[Tensor, "batch cx cy cz"]:
        size = grids.shape[1:]
        x, y, z = (
            (corner[:, axis, None] + torch.arange(self.shape[axis], device=grids.device) + 1).clamp(0, size[axis] - 1)
            for axis in range(3)
        )
        return grids[environment[:, None, None, None], x[:, :, None, None], y[:, None, :, None], z[:, None, None, :]]

    def _paint(self, channel: Float32[Tensor, "batch nx ny nz"], points: Float32[Tensor, "batch point 3"]) -> None:
        """max_p exp(-k |c - p|^2) at each cell centre c: a product of one factor an axis, so cheap."""
        centres = [self.resolution * torch.arange(cells, device=points.device) for cells in self.shape]
        x, y, z = (
            threshold((-self.sharpness * (points[..., axis, None] - centre).square()).exp(), NOTHING, 0.0)
            for axis, centre in enumerate(centres)
        )
        planes = (y[..., None] * z[..., None, :])[:, :, None]
        channel.zero_()
        value = torch.empty_like(channel)
        for line, plane in zip(x[..., None, None].unbind(1), planes.unbind(1), strict=True):
            torch.mul(line, plane, out=value)
            torch.maximum(channel, value, out=channel)
        threshold(channel, NOTHING, 0.0, inplace=True)
