"""What every trust classifier is: a network, what it needs of a state, and how it judges a transition."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int
from torch import Tensor, nn

from fairlead.core.errors import FairleadError, UnknownNameError
from fairlead.core.layout import StateLayout
from fairlead.core.records import Transitions
from fairlead.core.roles import Environment
from fairlead.learning.fit import Stage
from fairlead.learning.labels import RULES, Examples
from fairlead.learning.voxels import VoxelGrid

Inputs = Callable[[Int[np.ndarray, " row"]], tuple[Tensor, ...]]

NETWORKS = ("sdf", "voxel")
PAPER_GRID, PAPER_GRID_3D = VoxelGrid((100, 100, 4), 0.01), VoxelGrid((40, 40, 40), 0.02, 2000.0)
COARSE_GRID, COARSE_GRID_3D = VoxelGrid((50, 50, 1), 0.02), VoxelGrid((22, 22, 22), 0.04, 500.0)
"""Of dragging, and of the dual arm: the paper's, and coarse ones that are fast on a CPU."""


@dataclass(frozen=True)
class TrustConfig:
    """How a trust classifier is built and trained.

    Args:
        network: a name in `NETWORKS`.
        planar: motion in a horizontal plane: `sdf` turns its frame with the action, `voxel` convolves each layer of
            cells by itself (3 x 3 x 1).
        augment: learn from mirrored examples, too, `voxel` also from ones turned by quarters (in the plane its arena
            must be symmetric about the origin), and with two grippers from ones with the ends of the object exchanged.
            Not in the paper: Mitrano and Berenson, 2022.
        reach_known: actions that an arm cut short are no examples, for planning asks the arms themselves. False, the
            paper's: `voxel` learns from the world-frame state what is out of reach; `sdf` does not see it.
        hidden: hidden units (`voxel`), or channels of the convolutions along the chain (`sdf`).
        grid: the voxels (`voxel` only).
        rule: a name in `labels.RULES`.
        delta_m: largest error [m] of a reliable prediction; None for the dynamics' own delta (the paper's).
        limit: most training examples; a uniform sample beyond it.
        stages: minibatches are half reliable, half not.
        patience: epochs without improvement after which a stage ends.
    """

    network: str = "sdf"
    planar: bool = True
    augment: bool = True
    reach_known: bool = True
    hidden: int = 48
    grid: VoxelGrid = COARSE_GRID
    rule: str = "figure"
    delta_m: float | None = None
    limit: int = 200_000
    stages: tuple[Stage, ...] = (Stage(20, 256, 1e-3),)
    patience: int = 6

    def __post_init__(self) -> None:
        if self.network not in NETWORKS:
            raise UnknownNameError("trust network", self.network, NETWORKS)
        if self.rule not in RULES:
            raise UnknownNameError("labelling rule", self.rule, RULES)
        if min(self.hidden, self.limit, len(self.stages)) < 1:
            raise FairleadError("trust: hidden, limit and the number of stages must be positive")
        if self.delta_m is not None and not 0 < self.delta_m < math.inf:
            raise FairleadError(f"delta {self.delta_m}: a positive number of metres is needed")


class TrustNetwork(nn.Module, ABC):
    """A classifier of transitions. In training it sees `forward` alone, in planning `encode` and `judge`."""

    layout: StateLayout
    config: TrustConfig

    @abstractmethod
    def prepare(self, examples: Examples) -> Inputs:
        """How to get the inputs of `forward` for chosen rows of `examples`."""

    @abstractmethod
    def standardise(self, inputs: Inputs, count: int) -> None:
        """Learn scales from `count` training examples, before training begins."""

    @abstractmethod
    def augment(self, inputs: tuple[Tensor, ...], rng: np.random.Generator) -> tuple[Tensor, ...]:
        """Inputs changed in a way that leaves the label as it is."""

    @abstractmethod
    def forward(self, *inputs: Tensor) -> Float[Tensor, " batch"]:
        """The logit of each transition."""

    @abstractmethod
    def encode(
        self, environment: Environment, states: Float[np.ndarray, "batch state"]
    ) -> Float32[np.ndarray, "batch feature"]:
        """As `TransitionCheck.encode`."""

    @abstractmethod
    def judge(
        self,
        transitions: Transitions,
        encodings: Float32[np.ndarray, "batch feature"],
        next_encodings: Float32[np.ndarray, "batch feature"],
    ) -> Float[Tensor, " batch"]:
        """The logit of each transition, from encodings."""
