"""Networks for the unconstrained dynamics, chosen by name.

A network maps positions and actions in the local frame to the change of the positions in it. Everything is in
decimetres there, `UNIT_M`, about the length of a step. An entry of `NETWORKS` is called with a `Shape` and a generator.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fairlead.core.layout import StateLayout
from fairlead.learning.ensemble import ResidualStack, ensemble_mlp

UNIT_M = 0.1


def local_origin(layout: StateLayout, positions: Float[Tensor, "*batch position 3"]) -> Float[Tensor, "*batch 1 3"]:
    """As `geometry.frames.local_origin`, with a gradient."""
    grippers = len(layout.grippers)
    if grippers == 1:
        return positions[..., :1, :]
    return positions[..., grippers if layout.points else 0 :, :].mean(-2, keepdim=True)


@dataclass(frozen=True)
class Shape:
    """Sizes: ensemble members, grippers, rope points, axes (2 in the plane), hidden units, residual blocks."""

    members: int
    grippers: int
    points: int
    axes: int
    hidden: int
    blocks: int


class DynamicsNetwork(nn.Module, ABC):
    """Positions (member, batch, grippers + points, axes) and wanted displacements of the grippers -> changes."""

    @abstractmethod
    def forward(
        self,
        positions: Float[Tensor, "member batch position axis"],
        wanted: Float[Tensor, "member batch gripper axis"],
    ) -> Float[Tensor, "member batch position axis"]:
        """The change of each position."""


@final
class PaperMLP(DynamicsNetwork):
    """The paper's layers: two hidden ones with ReLU on the concatenated state and action."""

    def __init__(self, shape: Shape, generator: torch.Generator) -> None:
        super().__init__()
        state = (shape.grippers + shape.points) * shape.axes
        sizes = (state + shape.grippers * shape.axes, shape.hidden, shape.hidden, state)
        self.layers = ensemble_mlp(shape.members, sizes, generator)

    def forward(
        self,
        positions: Float[Tensor, "member batch position axis"],
        wanted: Float[Tensor, "member batch gripper axis"],
    ) -> Float[Tensor, "member batch position axis"]:
        """The change of each position."""
        targets = positions[:, :, : wanted.shape[2]] + wanted
        change = self.layers(torch.cat([positions.flatten(2), targets.flatten(2)], dim=-1))
        return change.view_as(positions)


@final
class Chain(DynamicsNetwork):
    """Knows that the rope is a chain: reads its links, predicts how they turn, and hangs them on what holds it.

    Grippers go to their targets up to a residual. Behind one gripper points follow by summing the predicted links, so a
    change near the gripper carries all that hangs on it. Between two, points are carried along by both, each by its
    share, and then moved. At first nothing turns: the rope is carried along.
    """

    def __init__(self, shape: Shape, generator: torch.Generator) -> None:
        super().__init__()
        moved, links = shape.grippers * shape.axes, shape.points * shape.axes
        other = (shape.grippers - 1) * shape.axes
        inputs, outputs = links + other + moved, moved + links
        self.layers = ResidualStack(shape.members, inputs, shape.hidden, shape.blocks, outputs, generator)
        self.share: Tensor
        self.register_buffer("share", torch.linspace(0, 1, shape.points), persistent=False)

    def forward(
        self,
        positions: Float[Tensor, "member batch position axis"],
        wanted: Float[Tensor, "member batch gripper axis"],
    ) -> Float[Tensor, "member batch position axis"]:
        """The change of each position."""
        grippers = wanted.shape[2]
        hung = torch.cat([positions[:, :, grippers:], positions[:, :, grippers - 1 : grippers]], dim=2)
        links = hung.diff(dim=2)
        between = positions[:, :, : grippers - 1] - positions[:, :, grippers - 1 : grippers]
        out = self.layers(torch.cat([2 * links.flatten(2), between.flatten(2), wanted.flatten(2)], dim=-1))
        moved = wanted + out[..., : wanted[0, 0].numel()].view_as(wanted)
        turned = out[..., wanted[0, 0].numel() :].view_as(links)
        if grippers == 1:
            followed = moved - turned.flip(2).cumsum(2).flip(2)
        else:
            followed = torch.lerp(moved[:, :, :1], moved[:, :, -1:], self.share[:, None]) + turned
        return torch.cat([moved, followed], dim=2)


NETWORKS: dict[str, Callable[[Shape, torch.Generator], DynamicsNetwork]] = {"mlp": PaperMLP, "chain": Chain}
