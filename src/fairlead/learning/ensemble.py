"""Layers of several networks at once: one batched product evaluates the whole ensemble."""

from __future__ import annotations

import itertools
import math

import torch
from jaxtyping import Float
from torch import Tensor, nn


class EnsembleLinear(nn.Module):
    """y_m = x_m W_m + b_m for every member m, drawn from `generator` as usual: U(-1, 1) / sqrt(inputs)."""

    def __init__(self, members: int, inputs: int, outputs: int, generator: torch.Generator) -> None:
        super().__init__()
        bound = 1 / math.sqrt(inputs)
        self.weight = nn.Parameter(torch.empty(members, inputs, outputs).uniform_(-bound, bound, generator=generator))
        self.bias = nn.Parameter(torch.empty(members, 1, outputs).uniform_(-bound, bound, generator=generator))

    def forward(self, x: Float[Tensor, "member batch inputs"]) -> Float[Tensor, "member batch outputs"]:
        """The layer."""
        return torch.baddbmm(self.bias, x, self.weight)


def ensemble_mlp(members: int, sizes: tuple[int, ...], generator: torch.Generator) -> nn.Sequential:
    """Linear layers of those sizes with ReLU between them."""
    layers: list[nn.Module] = []
    for inputs, outputs in itertools.pairwise(sizes):
        layers += [EnsembleLinear(members, inputs, outputs, generator), nn.ReLU()]
    return nn.Sequential(*layers[:-1])


class ResidualStack(nn.Module):
    """x_0 = W x;  x_{i+1} = x_i + W'' SiLU(W' norm(x_i));  y = V norm(x_n), with V = 0 at first."""

    def __init__(
        self, members: int, inputs: int, hidden: int, blocks: int, outputs: int, generator: torch.Generator
    ) -> None:
        super().__init__()
        self.first = EnsembleLinear(members, inputs, hidden, generator)
        self.blocks = nn.ModuleList(
            nn.Sequential(
                nn.LayerNorm(hidden, elementwise_affine=False),
                EnsembleLinear(members, hidden, hidden, generator),
                nn.SiLU(),
                EnsembleLinear(members, hidden, hidden, generator),
            )
            for _ in range(blocks)
        )
        self.norm = nn.LayerNorm(hidden, elementwise_affine=False)
        self.last = EnsembleLinear(members, hidden, outputs, generator)
        nn.init.zeros_(self.last.weight)
        nn.init.zeros_(self.last.bias)

    def forward(self, x: Float[Tensor, "member batch inputs"]) -> Float[Tensor, "member batch outputs"]:
        """All layers."""
        x = self.first(x)
        for block in self.blocks:
            x = x + block(x)
        return self.last(self.norm(x))
