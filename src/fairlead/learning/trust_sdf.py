"""`trust-sdf`: signed distances and their gradients at the points of both states, and a small network along the chain.

The paper shows its classifier the obstacles and the rope as voxels. What decides is how the points lie to the nearest
surfaces, and that can be looked up at the points themselves (docs/adr/0009).
"""

from __future__ import annotations

from typing import final

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor, nn

from fairlead.core.layout import StateLayout
from fairlead.core.records import Transitions
from fairlead.core.roles import Environment
from fairlead.geometry.frames import heading, local_origin, turn_into
from fairlead.learning.device import beside
from fairlead.learning.labels import Examples
from fairlead.learning.trust_network import Inputs, TrustConfig, TrustNetwork

UNIT_M = 0.1
FAR_M = 0.25
CONVOLUTIONS, WIDTH, HEAD = 3, 3, 128
"""Convolutions along the chain, how many neighbours each sees, and hidden units of the head."""
_VECTORS = 4


@final
class SdfTrust(TrustNetwork):
    """Standardised features of each position -> convolutions along the chain -> mean and maximum -> head -> logit.

    A position's features: where it is and how it moves, in the local frame, and distance [m] and gradient before and
    after; distances beyond `FAR_M` are all alike. The transition's: the displacements asked for, and the spread.
    Nothing tells where in the world all this is.
    """

    means: Tensor
    scales: Tensor
    whole_means: Tensor
    whole_scales: Tensor

    def __init__(self, layout: StateLayout, config: TrustConfig) -> None:
        super().__init__()
        self.layout, self.config = layout, config
        self._axes = 2 if config.planar else 3
        first, grippers = len(layout.grippers) - 1, len(layout.grippers)
        # Along the chain: every gripper but the last, the object, the last gripper.
        self._order = [*range(first), *range(grippers, layout.state_size // 3), first]
        seen, whole = _VECTORS * self._axes + 2, grippers * self._axes + 1
        for name, size in (("", seen), ("whole_", whole)):
            self.register_buffer(f"{name}means", torch.zeros(size))
            self.register_buffer(f"{name}scales", torch.ones(size))
        sizes = (seen, *[config.hidden] * (CONVOLUTIONS - 1))
        self.along = nn.ModuleList(nn.Conv1d(n, config.hidden, WIDTH, padding=WIDTH // 2) for n in sizes)
        self.asked = nn.Linear(whole, config.hidden)
        self.head = nn.Sequential(nn.Linear(2 * config.hidden + whole, HEAD), nn.ReLU(), nn.Linear(HEAD, 1))

    def forward(self, *inputs: Tensor) -> Float[Tensor, " batch"]:
        chain, whole = inputs
        whole = (whole - self.whole_means) / self.whole_scales
        x = ((chain - self.means) / self.scales).transpose(1, 2)
        x = torch.relu(self.along[0](x) + self.asked(whole)[..., None])
        for convolution in self.along[1:]:
            x = x + torch.relu(convolution(x))
        return self.head(torch.cat([x.mean(2), x.amax(2), whole], dim=1)).squeeze(-1)

    def prepare(self, examples: Examples) -> Inputs:
        chain = np.empty((len(examples), len(self._order), len(self.means)), np.float32)
        whole = np.empty((len(examples), len(self.whole_means)), np.float32)
        for environment, rows in examples.by_scene():
            t = examples.take(rows).transitions
            fields = (self.encode(environment, states) for states in (t.states, t.next_states))
            chain[rows], whole[rows] = self._features(t, *fields)
        there = beside(self, chain), beside(self, whole)
        return lambda rows: (there[0][rows], there[1][rows])

    def standardise(self, inputs: Inputs, count: int) -> None:
        chain, whole = inputs(np.arange(count))
        for name, found in (("", chain.flatten(0, 1)), ("whole_", whole)):
            getattr(self, f"{name}means").copy_(found.mean(0))
            getattr(self, f"{name}scales").copy_(found.std(0).clamp_min(1e-3))

    def augment(self, inputs: tuple[Tensor, ...], rng: np.random.Generator) -> tuple[Tensor, ...]:
        """Mirror half of the examples at the frame's first axis; with two grippers, exchange the ends of half of them.

        Exchanged, the frame, which runs from the first gripper to the last, is turned by half a turn.
        """
        if not self.config.augment:
            return inputs
        chain, whole = _signed(inputs, self._some(len(inputs[0]), rng), self._axes, (1, -1, 1))
        if len(self.layout.grippers) == 2:
            some, a = self._some(len(chain), rng), self._axes
            chain = torch.where(some[:, None, None], chain.flip(1), chain)
            exchanged = torch.cat([whole[:, a : 2 * a], whole[:, :a], whole[:, 2 * a :]], dim=1)
            whole = torch.where(some[:, None], exchanged, whole)
            chain, whole = _signed((chain, whole), some, a, (-1, -1, 1))
        return chain, whole

    def encode(
        self, environment: Environment, states: Float[np.ndarray, "batch state"]
    ) -> Float32[np.ndarray, "batch feature"]:
        found = environment.distance_and_gradient(states.reshape(len(states), -1, 3))
        return found.reshape(len(states), -1).astype(np.float32, copy=False)

    def judge(
        self,
        transitions: Transitions,
        encodings: Float32[np.ndarray, "batch feature"],
        next_encodings: Float32[np.ndarray, "batch feature"],
    ) -> Float[Tensor, " batch"]:
        return self(*(beside(self, x) for x in self._features(transitions, encodings, next_encodings)))

    def _features(
        self,
        t: Transitions,
        encodings: Float32[np.ndarray, "batch feature"],
        next_encodings: Float32[np.ndarray, "batch feature"],
    ) -> tuple[Float32[np.ndarray, "batch position feature"], Float32[np.ndarray, "batch whole"]]:
        """What `forward` sees: of each position in the order of the chain, and of the transition."""
        batch = len(t)
        before, after = (x.reshape(batch, -1, 3) for x in (t.states, t.next_states))
        asked = (t.actions - t.states[:, : self.layout.action_size]).reshape(batch, -1, 3) / UNIT_M
        fields = [x.reshape(batch, -1, 4) for x in (encodings, next_encodings)]
        moves = [(before - local_origin(self.layout, t.states)[:, None]) / UNIT_M, (after - before) / UNIT_M]
        along = heading(self.layout, t.states, t.actions)
        vectors = [self._turned(along, x)[:, self._order] for x in (*moves, *(field[..., 1:] for field in fields))]
        distances = [np.clip(field[:, self._order, :1], -FAR_M, FAR_M) / UNIT_M for field in fields]
        doubt = np.log(np.maximum(t.spread, 1e-6))[:, None]
        whole = np.concatenate([self._turned(along, asked).reshape(batch, -1), doubt], axis=1, dtype=np.float32)
        return np.concatenate([*vectors, *distances], axis=-1, dtype=np.float32), whole

    def _some(self, count: int, rng: np.random.Generator) -> Tensor:
        """Half of the rows, by chance."""
        return beside(self, rng.random(count) < 0.5)

    def _turned(
        self, along: Float[np.ndarray, "batch 2"], vectors: Float[np.ndarray, "batch position 3"]
    ) -> Float[np.ndarray, "batch position axis"]:
        flat = turn_into(along, vectors[..., :2])
        return flat if self._axes == 2 else np.concatenate([flat, vectors[..., 2:]], axis=-1)


def _signed(inputs: tuple[Tensor, ...], rows: Tensor, axes: int, signs: tuple[int, int, int]) -> tuple[Tensor, Tensor]:
    """Chain and whole features with the signs of the axes of every vector changed in some rows."""
    axis = inputs[0].new_tensor(signs[:axes])
    signed = []
    for x, scalars in zip(inputs, (2, 1), strict=True):
        sign = torch.cat([axis.repeat((x.shape[-1] - scalars) // axes), axis.new_ones(scalars)])
        signed.append(torch.where(rows.view(-1, *[1] * (x.ndim - 1)), x * sign, x))
    return signed[0], signed[1]
