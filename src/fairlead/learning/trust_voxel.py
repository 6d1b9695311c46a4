"""The paper's classifier: voxels, three convolutions, and an LSTM over the two states (paper, Fig. 4B)."""

from __future__ import annotations

import math
from typing import final

import numpy as np
import torch
from jaxtyping import Float, Float32, Int
from torch import Tensor, nn

from fairlead.core.errors import FairleadError
from fairlead.core.layout import StateLayout
from fairlead.core.records import Transitions
from fairlead.core.roles import Environment
from fairlead.geometry.frames import local_origin
from fairlead.learning.device import beside, device_of
from fairlead.learning.labels import Examples
from fairlead.learning.trust_network import Inputs, TrustConfig, TrustNetwork
from fairlead.learning.voxels import Occupancy, VoxelGrid

FILTERS = 26
LAYERS = 3
AT_ONCE = 200_000
"""Cells that a CPU encodes at once: 21 MB after the first layer. More is fetched from the system anew, page by page."""
DRAWN = 256
"""States whose voxels are held at once: of the paper's grid in three dimensions each takes a megabyte."""


@final
class VoxelEncoder(nn.Module):
    """Three times a convolution (valid), ReLU and max-pooling, then flattened.

    A planar encoder's kernels are 3 x 3 x 1 and its pools 2 x 2 x 1: each layer of cells by itself, so layers are
    folded into the batch of a two-dimensional convolution.
    """

    def __init__(self, channels: int, grid: VoxelGrid, planar: bool) -> None:
        super().__init__()
        self.grid, self.planar = grid, planar
        convolution, pool = (nn.Conv2d, nn.MaxPool2d) if planar else (nn.Conv3d, nn.MaxPool3d)
        layers: list[nn.Module] = []
        for layer in range(LAYERS):
            # ReLU after the pool is the same as before it, on a quarter of the numbers.
            layers += [convolution(FILTERS if layer else channels, FILTERS, 3), pool(2), nn.ReLU()]
        self.layers = nn.Sequential(*layers)
        sizes = [self._left(cells) for cells in (grid.shape[:2] if planar else grid.shape)]
        if min(sizes) < 1:
            raise FairleadError(f"a voxel grid of {grid.shape} cells is too small for {LAYERS} convolutions")
        self.size = FILTERS * math.prod(sizes) * (grid.shape[2] if planar else 1)

    @staticmethod
    def _left(cells: int) -> int:
        for _ in range(LAYERS):
            cells = (cells - 2) // 2
        return cells

    def forward(self, voxels: Float[Tensor, "batch channel nx ny nz"]) -> Float[Tensor, "batch feature"]:
        """Features of each grid."""
        return torch.cat([self._features(part) for part in voxels.split(self._at_once(voxels))])

    def _at_once(self, voxels: Float[Tensor, "batch channel nx ny nz"]) -> int:
        """How many grids: on a CPU so few that the first layer's output stays in memory that is used again."""
        return max(1, AT_ONCE // math.prod(self.grid.shape)) if voxels.device.type == "cpu" else len(voxels)

    def _features(self, voxels: Float[Tensor, "batch channel nx ny nz"]) -> Float[Tensor, "batch feature"]:
        if self.planar:
            voxels = voxels.permute(0, 4, 1, 2, 3).flatten(0, 1)
        if voxels.device.type != "cpu":
            found = self.layers(voxels)
        elif torch.backends.mkldnn.is_available() and not torch.is_grad_enabled():
            # The layout that oneDNN chooses itself takes three quarters of the time; with gradients it takes more.
            found = self.layers(voxels.to_mkldnn()).to_dense()
        else:
            layout = torch.channels_last if self.planar else torch.channels_last_3d
            found = self.layers(voxels.contiguous(memory_format=layout))
        return found.reshape(-1, self.size)


@final
class VoxelTrust(TrustNetwork):
    """[features, world state, local state, local action, spread] -> BatchNorm -> Dense -> LSTM -> logit.

    Both states go through the same layers with the action in their own frame; the logit after the second is used.
    BatchNorm and Dense are linear in planning, so an encoding holds all that Dense makes of a state, and the action and
    the spread are added when a transition is judged.
    """

    def __init__(self, layout: StateLayout, config: TrustConfig) -> None:
        super().__init__()
        self.layout, self.config, self.grid = layout, config, config.grid
        self.encoder = VoxelEncoder(config.grid.channels(layout), config.grid, config.planar)
        self._of_state = self.encoder.size + 2 * layout.state_size
        self.norm = nn.BatchNorm1d(self._of_state + layout.action_size + 1)
        self.dense = nn.Linear(self.norm.num_features, config.hidden)
        self.lstm = nn.LSTM(config.hidden, config.hidden)
        self.out = nn.Linear(config.hidden, 1)

    def forward(self, *inputs: Tensor) -> Float[Tensor, " batch"]:
        voxels, states, extra = inputs
        batch = voxels.shape[1]
        features = self.encoder(voxels.flatten(0, 1))
        seen = torch.cat([features, states.flatten(0, 1), extra.flatten(0, 1)], dim=1)
        return self._recur(self.dense(self.norm(seen)).view(2, batch, -1))

    def _recur(self, dense: Float[Tensor, "2 batch hidden"]) -> Float[Tensor, " batch"]:
        return self.out(self.lstm(torch.relu(dense))[0][1]).squeeze(-1)

    def prepare(self, examples: Examples) -> Inputs:
        occupancy = Occupancy.of(examples.environments, self.grid.resolution, device_of(self))

        def inputs(rows: np.ndarray) -> tuple[Tensor, ...]:
            t, scene = examples.take(rows).transitions, examples.scene[rows]
            drawn = torch.stack([self.grid.draw(self.layout, occupancy, scene, s) for s in (t.states, t.next_states)])
            states = torch.stack([self._vectors(t.states), self._vectors(t.next_states)])
            return drawn, states, self._extra(t)

        return inputs

    def standardise(self, inputs: Inputs, count: int) -> None:
        """Nothing to do: BatchNorm."""

    def augment(self, inputs: tuple[Tensor, ...], rng: np.random.Generator) -> tuple[Tensor, ...]:
        """Each example in one of the square's eight symmetries; with two grippers half of them exchanged, too.

        Not one symmetry for a whole minibatch: its statistics, which BatchNorm collects, would be those of one side.
        Not where reach is learned from the place in the world: arms do not turn with it.
        """
        if not self.config.augment or not (self.config.planar or self.config.reach_known):
            return inputs
        square, two = self.grid.shape[0] == self.grid.shape[1], len(self.layout.grippers) == 2
        symmetries = rng.integers(0, 2, (inputs[0].shape[1], 4)) * (1, 1, square, two)
        changed = tuple(map(torch.empty_like, inputs))
        for symmetry in np.unique(symmetries, axis=0):
            rows = np.flatnonzero((symmetries == symmetry).all(1))
            found = self._changed(tuple(x[:, rows] for x in inputs), symmetry[:3], bool(symmetry[3]))
            for whole, part in zip(changed, found, strict=True):
                whole[:, rows] = part
        return changed

    def _changed(
        self, inputs: tuple[Tensor, ...], symmetry: Int[np.ndarray, " 3"], exchange: bool
    ) -> tuple[Tensor, ...]:
        """Inputs of `forward` in one symmetry, the grippers and all that hangs between them exchanged or not."""
        voxels, states, extra = inputs
        grippers, size = len(self.layout.grippers), self.layout.action_size
        positions, targets = states.unflatten(-1, (2, -1, 3)), extra[..., :size].unflatten(-1, (-1, 3))
        if exchange:
            voxels = torch.cat([voxels[:, :, :-grippers], voxels[:, :, -grippers:].flip(2)], dim=2)
            positions = torch.cat(
                [positions[..., :grippers, :].flip(-2), positions[..., grippers:, :].flip(-2)], dim=-2
            )
            targets = targets.flip(-2)
        moved = transformed(positions, symmetry).flatten(-3), transformed(targets, symmetry).flatten(-2)
        return transformed_grid(voxels, symmetry), moved[0], torch.cat([moved[1], extra[..., size:]], dim=-1)

    def frozen(
        self, environment: Environment, states: Float[np.ndarray, "batch state"]
    ) -> Float32[np.ndarray, "batch frozen"]:
        return self._look(environment, states).cpu().numpy()

    def encode(
        self, environment: Environment, states: Float[np.ndarray, "batch state"]
    ) -> Float32[np.ndarray, "batch feature"]:
        weight, bias = self._folded()
        seen = torch.cat([self._look(environment, states), self._vectors(states)], dim=1)
        return torch.addmm(bias, seen, weight[:, : self._of_state].T).cpu().numpy()

    def judge(
        self,
        transitions: Transitions,
        encodings: Float32[np.ndarray, "batch feature"],
        next_encodings: Float32[np.ndarray, "batch feature"],
    ) -> Float[Tensor, " batch"]:
        weight, _ = self._folded()
        encoded = beside(self, np.stack([encodings, next_encodings]))
        return self._recur(encoded + self._extra(transitions) @ weight[:, self._of_state :].T)

    def _look(self, environment: Environment, states: Float[np.ndarray, "batch state"]) -> Float[Tensor, "batch f"]:
        occupancy = Occupancy.of([environment], self.grid.resolution, device_of(self))
        some = [states[low : low + DRAWN] for low in range(0, max(1, len(states)), DRAWN)]
        drawn = (self.grid.draw(self.layout, occupancy, np.zeros(len(part), np.intp), part) for part in some)
        return torch.cat([self.encoder(voxels) for voxels in drawn])

    def _vectors(self, states: Float[np.ndarray, "batch state"]) -> Float[Tensor, "batch vector"]:
        """World-frame and local state."""
        local = states - np.tile(local_origin(self.layout, states), self.layout.state_size // 3)
        return beside(self, np.concatenate([states, local], axis=1, dtype=np.float32))

    def _extra(self, t: Transitions) -> Float[Tensor, "2 batch extra"]:
        """The action in the local frame of each of the two states, and the spread of the prediction."""
        grippers = len(self.layout.grippers)
        local = [t.actions - np.tile(local_origin(self.layout, s), grippers) for s in (t.states, t.next_states)]
        both = [np.concatenate([a, t.spread[:, None]], axis=1, dtype=np.float32) for a in local]
        return beside(self, np.stack(both))

    def _folded(self) -> tuple[Float[Tensor, "hidden input"], Float[Tensor, " hidden"]]:
        """Dense(BatchNorm(x)) = W' x + b' with the running statistics."""
        norm = self.norm
        assert norm.running_var is not None
        assert norm.running_mean is not None
        scale = norm.weight * torch.rsqrt(norm.running_var + norm.eps)
        shift = norm.bias - norm.running_mean * scale
        return self.dense.weight * scale, self.dense.bias + self.dense.weight @ shift


def transformed(vectors: Float[Tensor, "*batch 3"], symmetry: Int[np.ndarray, " 3"]) -> Float[Tensor, "*batch 3"]:
    """Mirror x, mirror y, exchange x and y: each where `symmetry` is 1."""
    if not symmetry.any():
        return vectors
    x, y, z = (vectors * vectors.new_tensor([*(1 - 2.0 * symmetry[:2]), 1.0])).unbind(-1)
    return torch.stack([y, x, z] if symmetry[2] else [x, y, z], dim=-1)


def inverse(symmetry: Int[np.ndarray, " 3"]) -> Int[np.ndarray, " 3"]:
    """What undoes it: where x and y were exchanged last, their mirrors are exchanged, too."""
    return symmetry[[1, 0, 2]] if symmetry[2] else symmetry


def transformed_grid(
    voxels: Float[Tensor, "*batch nx ny nz"], symmetry: Int[np.ndarray, " 3"]
) -> Float[Tensor, "*batch nx ny nz"]:
    """The same for a grid about its middle cell, n // 2. Where the size is even, the first cells stay: no partner."""
    for axis in (-3, -2):
        if symmetry[axis + 3]:
            voxels = voxels.flip(axis)
            if voxels.shape[axis] % 2 == 0:
                voxels = voxels.roll(1, axis)
    return voxels.transpose(-3, -2) if symmetry[2] else voxels
