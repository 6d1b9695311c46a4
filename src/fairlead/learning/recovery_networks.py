"""What says how likely an action leads out of a stuck state: the paper's head on frozen features, and our own chain.

The paper's takes over the classifier's convolutions as they are. The chain is the network of `trust-sdf`, trained anew
for this question (docs/adr/0010).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import final

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor, nn

from fairlead.core.layout import StateLayout
from fairlead.core.records import Transitions
from fairlead.core.roles import Environment
from fairlead.geometry.frames import local_origin
from fairlead.learning.device import beside
from fairlead.learning.labels import Examples
from fairlead.learning.stuck import RecoveryExamples
from fairlead.learning.trust_network import Inputs
from fairlead.learning.trust_sdf import SdfTrust
from fairlead.learning.trust_voxel import VoxelTrust


class RecoveryNetwork(nn.Module, ABC):
    """A judge of actions in stuck states. In training it sees `forward` alone, in a trial `judge`."""

    @abstractmethod
    def prepare(self, environments: Sequence[Environment], examples: RecoveryExamples) -> Inputs:
        """How to get the inputs of `forward` for chosen rows of `examples`."""

    @abstractmethod
    def standardise(self, inputs: Inputs, count: int) -> None:
        """Learn scales from `count` training examples, before training begins."""

    @abstractmethod
    def augment(self, inputs: tuple[Tensor, ...], rng: np.random.Generator) -> tuple[Tensor, ...]:
        """Inputs changed in a way that leaves the label as it is."""

    @abstractmethod
    def judge(
        self,
        environment: Environment,
        states: Float[np.ndarray, "batch state"],
        actions: Float[np.ndarray, "batch sample action"],
    ) -> Float[Tensor, " judged"]:
        """The logit of every action, those of the first state first."""


@final
class FrozenRecovery(RecoveryNetwork):
    """[frozen features, world state, local state, local action] -> BatchNorm -> hidden -> hidden -> logit."""

    def __init__(self, trust: VoxelTrust, hidden: int) -> None:
        super().__init__()
        self.trust, layout = trust.requires_grad_(False), trust.layout
        self.inputs = trust.encoder.size + 2 * layout.state_size + layout.action_size
        self.head = nn.Sequential(
            nn.BatchNorm1d(self.inputs),
            nn.Linear(self.inputs, hidden),
            nn.ReLU(),
            nn.Linear(hidden, hidden),
            nn.ReLU(),
            nn.Linear(hidden, 1),
        )

    def train(self, mode: bool = True) -> FrozenRecovery:
        super().train(mode)
        self.trust.eval()
        return self

    def forward(self, *inputs: Tensor) -> Float[Tensor, " batch"]:
        return self.head(inputs[0]).squeeze(-1)

    def prepare(self, environments: Sequence[Environment], examples: RecoveryExamples) -> Inputs:
        rows = np.empty((len(examples), self.inputs), np.float32)
        for scene in np.unique(examples.scene):
            of = np.flatnonzero(examples.scene == scene)
            rows[of] = self._inputs(environments[scene], examples.states[of], examples.actions[of, None])
        there = beside(self, rows)
        return lambda chosen: (there[chosen],)

    def standardise(self, inputs: Inputs, count: int) -> None:
        """Nothing to do: BatchNorm."""

    def augment(self, inputs: tuple[Tensor, ...], rng: np.random.Generator) -> tuple[Tensor, ...]:
        return inputs

    def judge(
        self,
        environment: Environment,
        states: Float[np.ndarray, "batch state"],
        actions: Float[np.ndarray, "batch sample action"],
    ) -> Float[Tensor, " judged"]:
        return self(beside(self, self._inputs(environment, states, actions)))

    def _inputs(
        self,
        environment: Environment,
        states: Float[np.ndarray, "batch state"],
        actions: Float[np.ndarray, "batch sample action"],
    ) -> Float32[np.ndarray, "judged input"]:
        samples, origin = actions.shape[1], local_origin(self.trust.layout, states)
        local = states - np.tile(origin, states.shape[1] // 3)
        asked = (actions - np.tile(origin, actions.shape[2] // 3)[:, None]).reshape(-1, actions.shape[2])
        with torch.inference_mode():
            seen = self.trust.frozen(environment, states)
        known = np.concatenate([seen, states, local], axis=1, dtype=np.float32)
        return np.concatenate([np.repeat(known, samples, axis=0), asked], axis=1, dtype=np.float32)


@final
class ChainRecovery(RecoveryNetwork):
    """The network of `trust-sdf` on the transition in which the object would be carried along with the grippers.

    No prediction of the dynamics goes in: where this is asked, none is trusted.
    """

    def __init__(self, trust: SdfTrust) -> None:
        super().__init__()
        self.chain = SdfTrust(trust.layout, trust.config)

    def forward(self, *inputs: Tensor) -> Float[Tensor, " batch"]:
        return self.chain(*inputs)

    def prepare(self, environments: Sequence[Environment], examples: RecoveryExamples) -> Inputs:
        count = len(examples)
        unused = np.zeros(count), np.zeros(count)
        return self.chain.prepare(
            Examples(
                self.chain.layout,
                environments,
                carried_along(self.chain.layout, examples.states, examples.actions),
                examples.share > 0,
                *unused,
                examples.scene,
                np.zeros((count, 3), int),
            )
        )

    def standardise(self, inputs: Inputs, count: int) -> None:
        self.chain.standardise(inputs, count)

    def augment(self, inputs: tuple[Tensor, ...], rng: np.random.Generator) -> tuple[Tensor, ...]:
        return self.chain.augment(inputs, rng)

    def judge(
        self,
        environment: Environment,
        states: Float[np.ndarray, "batch state"],
        actions: Float[np.ndarray, "batch sample action"],
    ) -> Float[Tensor, " judged"]:
        samples = actions.shape[1]
        before = np.repeat(self.chain.encode(environment, states), samples, axis=0)
        t = carried_along(self.chain.layout, np.repeat(states, samples, axis=0), actions.reshape(len(before), -1))
        return self.chain.judge(t, before, self.chain.encode(environment, t.next_states))


def carried_along(
    layout: StateLayout, states: Float[np.ndarray, "batch state"], actions: Float[np.ndarray, "batch action"]
) -> Transitions:
    """Where the object would be if its points moved as the grippers do, in proportion along the chain."""
    moves = actions.reshape(len(states), -1, 3) - layout.grippers_of(states)
    share = np.linspace(0.0, 1.0, layout.points)[:, None]
    points = layout.points_of(states) + (1 - share) * moves[:, None, 0] + share * moves[:, None, -1]
    ahead = layout.join(actions.reshape(moves.shape), points)
    return Transitions(states, actions, ahead, np.ones(len(states), np.float32))
