"""The unconstrained dynamics: an ensemble of networks that predict how a state changes, in a local frame.

Paper, "Learning the unconstrained dynamics" and "Incorporating uncertainty in the learned dynamics".
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar, final

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from fairlead.core.errors import FairleadError, UnknownNameError
from fairlead.core.layout import StateLayout
from fairlead.core.records import Prediction
from fairlead.core.roles import Dynamics, Environment
from fairlead.core.streams import stream_seed
from fairlead.learning.device import CPU, beside
from fairlead.learning.fit import Stage, fit, stages_from
from fairlead.learning.model_files import Job, ModelFile, save_model
from fairlead.learning.networks import NETWORKS, UNIT_M, Shape, local_origin
from fairlead.learning.rollout import Splits, dynamics_metrics
from fairlead.learning.rollout_task import RolloutTask

_STAGES = (Stage(60, 512, 1e-3, 1), Stage(12, 256, 3e-4, 4), Stage(12, 128, 1e-4, 10))


@dataclass(frozen=True)
class DynamicsConfig:
    """How the ensemble is built and trained.

    Args:
        network: a name in `NETWORKS`.
        hidden: hidden units of a layer (the paper's network: 1024).
        blocks: residual blocks of `chain`; `mlp` has none.
        members: networks in the ensemble.
        planar: the object moves in a horizontal plane: heights are left alone.
        stages: one-step predictions at a large batch first, then several steps at a smaller rate.
        patience: epochs without improvement after which a stage ends.
    """

    network: str = "chain"
    hidden: int = 256
    blocks: int = 3
    members: int = 8
    planar: bool = True
    stages: tuple[Stage, ...] = _STAGES
    patience: int = 30

    def __post_init__(self) -> None:
        if self.network not in NETWORKS:
            raise UnknownNameError("dynamics network", self.network, NETWORKS)
        if min(self.hidden, self.members, len(self.stages)) < 1:
            raise FairleadError("dynamics: hidden, members and the number of stages must be positive")


class FreeMotion(nn.Module, ABC):
    """A network that predicts motion that nothing constrains, and how far its prediction may be off."""

    layout: StateLayout

    @abstractmethod
    def prediction(
        self, states: Float[Tensor, "batch state"], actions: Float[Tensor, "batch action"]
    ) -> tuple[Float[Tensor, "batch state"], Float[Tensor, " batch"]]:
        """The next state of each row and the spread about it [m]."""


@final
class Ensemble(FreeMotion):
    """One step of every member: into the local frame, the network, and back. Weights derive from `seed`."""

    def __init__(self, layout: StateLayout, config: DynamicsConfig, seed: int) -> None:
        super().__init__()
        self.layout, self.config, self.planar, self.members = layout, config, config.planar, config.members
        self.axes = 2 if config.planar else 3
        shape = Shape(config.members, len(layout.grippers), layout.points, self.axes, config.hidden, config.blocks)
        generator = torch.Generator().manual_seed(stream_seed(seed, "dynamics", "weights"))
        self.network = NETWORKS[config.network](shape, generator)

    def forward(
        self, states: Float[Tensor, "member batch state"], actions: Float[Tensor, "member batch action"]
    ) -> Float[Tensor, "member batch state"]:
        """The next state that each member predicts for its own rows [m]."""
        return self.moved(states, *self.local(states, actions))

    def prediction(
        self, states: Float[Tensor, "batch state"], actions: Float[Tensor, "batch action"]
    ) -> tuple[Float[Tensor, "batch state"], Float[Tensor, " batch"]]:
        """The members' mean, and their standard deviation, summed over the state."""
        predicted = self(states.expand(self.members, -1, -1), actions.expand(self.members, -1, -1))
        mean = predicted.mean(0)
        return mean, (predicted - mean).square().mean(0).sqrt().sum(-1)

    def local(
        self, states: Float[Tensor, "member batch state"], actions: Float[Tensor, "member batch action"]
    ) -> tuple[
        Float[Tensor, "member batch position axis"],
        Float[Tensor, "member batch gripper axis"],
        Float[Tensor, "member batch axis axis"],
    ]:
        """Positions and wanted displacements in the local frame [dm], and its axes as columns."""
        count = len(self.layout.grippers)
        positions = states.unflatten(-1, (-1, 3))
        wanted = actions.unflatten(-1, (-1, 3)) - positions[:, :, :count]
        local = positions - local_origin(self.layout, positions)
        turn = self._turn(positions, wanted)
        local, wanted = ((x[..., : self.axes] @ turn) / UNIT_M for x in (local, wanted))
        return local, wanted, turn

    def moved(
        self,
        states: Float[Tensor, "member batch state"],
        local: Float[Tensor, "member batch position axis"],
        wanted: Float[Tensor, "member batch gripper axis"],
        turn: Float[Tensor, "member batch axis axis"],
    ) -> Float[Tensor, "member batch state"]:
        """The next state [m], from what `local` says of the state and the action."""
        change = UNIT_M * self.network(local, wanted) @ turn.transpose(-1, -2)
        return states + nn.functional.pad(change, (0, 3 - self.axes)).flatten(2)

    def _turn(
        self, positions: Float[Tensor, "member batch position 3"], wanted: Float[Tensor, "member batch gripper 3"]
    ) -> Float[Tensor, "member batch axis axis"]:
        """Columns are the local axes, turned about the vertical as `geometry.frames.heading`, in single precision."""
        count = wanted.shape[2]
        along = (positions[:, :, count - 1] - positions[:, :, 0] if count > 1 else wanted[:, :, 0])[..., :2].detach()
        length = along.norm(dim=-1, keepdim=True)
        ahead = along.new_tensor([1.0, 0.0])
        x, y = torch.where(length > 1e-6, along / length.clamp_min(1e-6), ahead).unbind(-1)
        turn = torch.stack([x, -y, y, x], dim=-1).unflatten(-1, (2, 2))
        if self.planar:
            return turn
        upright = torch.eye(3, device=turn.device).expand(*turn.shape[:2], 3, 3).clone()
        upright[..., :2, :2] = turn
        return upright


M = TypeVar("M", bound=FreeMotion)


@final
class LearnedDynamics(Dynamics, Generic[M]):
    """What a trained network predicts of motion that nothing constrains. The environment is ignored."""

    def __init__(self, module: M) -> None:
        self.module = module

    @property
    def layout(self) -> StateLayout:
        return self.module.layout

    def predict(
        self,
        environment: Environment,
        states: Float[np.ndarray, "batch state"],
        actions: Float[np.ndarray, "batch action"],
    ) -> Prediction:
        with torch.inference_mode():
            s, a = (beside(self.module, np.asarray(x, np.float32)) for x in (states, actions))
            mean, spread = self.module.prediction(s, a)
        return Prediction(mean.cpu().numpy(), spread.cpu().numpy())

    def predict_each(
        self,
        environments: Sequence[Environment],
        scene: Int[np.ndarray, " batch"],
        states: Float[np.ndarray, "batch state"],
        actions: Float[np.ndarray, "batch action"],
    ) -> Prediction:
        return self.predict(environments[scene[0]], states, actions)


def train_dynamics(data: Splits, config: DynamicsConfig, job: Job) -> LearnedDynamics[Ensemble]:
    """Train the ensemble on unconstrained data and save it; delta is in its `metrics.json`."""
    started = time.monotonic()
    module = Ensemble(data.layout, config, job.seed).to(job.device)
    dynamics = LearnedDynamics(module)
    task = RolloutTask(
        module, lambda states, actions, *_: module(states, actions), dynamics, data, config.members, mirror=True
    )
    key = job.key("dynamics", config)
    earlier_s = fit(task, config.stages, job.seed, job.folder, key=key, patience=config.patience, title="dynamics")
    metrics = dynamics_metrics(dynamics, data)
    seconds = earlier_s + time.monotonic() - started
    save_model(job, "dynamics", config.network, data.layout, config, module.state_dict(), metrics, seconds)
    return dynamics


def dynamics_config_from(values: Mapping[str, Any]) -> DynamicsConfig:
    """The configuration as a model's `config.json` has it."""
    return DynamicsConfig(**{**values, "stages": stages_from(values["stages"])})


def dynamics_from(model: ModelFile, device: torch.device = CPU) -> LearnedDynamics[Ensemble]:
    """The dynamics of a model that was read."""
    module = Ensemble(model.layout, dynamics_config_from(model.config), 0)
    model.load_into(module)
    return LearnedDynamics(module.to(device))
