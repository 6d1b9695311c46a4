"""One network that predicts what an ensemble predicts: nearly as exact, and two to three times as fast to plan with.

Not in the paper. Distillation (Hinton, Vinyals and Dean, 2015): the ensemble itself tells what there is to learn, so
any state and action will do, and nothing is recorded for it. Classifiers, whose labels are of the ensemble's
predictions, are a little too sure of this network's.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from fairlead.core.errors import FairleadError
from fairlead.core.layout import StateLayout
from fairlead.core.records import Prediction, Trajectories
from fairlead.core.roles import ActionSampler, Dynamics, Environment
from fairlead.core.streams import stream, stream_seed
from fairlead.geometry.distance import point_error
from fairlead.learning.device import beside, device_of
from fairlead.learning.dynamics import (
    DynamicsConfig,
    Ensemble,
    FreeMotion,
    LearnedDynamics,
    dynamics_config_from,
)
from fairlead.learning.ensemble import ensemble_mlp
from fairlead.learning.fit import Stage, Task, fit, stages_from
from fairlead.learning.model_files import Job, ModelFile, save_model
from fairlead.learning.networks import UNIT_M
from fairlead.learning.rollout import Splits, roll_out, roll_out_all

LEAST_SPREAD_M, USUAL_SPREAD_M = 1e-6, 1e-2


@dataclass(frozen=True)
class DistilledConfig:
    """How an ensemble is distilled.

    Args:
        samples: predictions of the ensemble to learn from; an eighth as many more judge, and another eighth test.
        hidden: hidden units of the two layers that predict the spread; the mean's network is as a member's.
        stages: of training; their horizon means nothing here.
    """

    samples: int = 400_000
    hidden: int = 64
    stages: tuple[Stage, ...] = (Stage(8, 256, 5e-4),)

    def __post_init__(self) -> None:
        if min(self.samples // 8, self.hidden, len(self.stages)) < 1:
            raise FairleadError("distilled: hidden and the number of stages must be positive, samples at least 8")


@final
class Distilled(FreeMotion):
    """A network like a member's for the ensemble's mean, and a small one for the logarithm of its spread [m]."""

    def __init__(self, layout: StateLayout, of: DynamicsConfig, config: DistilledConfig, seed: int) -> None:
        super().__init__()
        self.layout = layout
        self.mean = Ensemble(layout, replace(of, members=1), seed)
        axes, grippers = self.mean.axes, len(layout.grippers)
        sizes = (layout.state_size // 3 * axes + grippers * axes, config.hidden, config.hidden, 1)
        generator = torch.Generator().manual_seed(stream_seed(seed, "distilled", "weights"))
        self.spread = ensemble_mlp(1, sizes, generator)
        nn.init.constant_(self.spread.get_parameter("4.bias"), math.log(USUAL_SPREAD_M))

    def begin_with(self, ensemble: Ensemble) -> None:
        """Take the weights of the ensemble's first member."""
        self.mean.load_state_dict({name: value[:1] for name, value in ensemble.state_dict().items()})

    def forward(
        self, states: Float[Tensor, "batch state"], actions: Float[Tensor, "batch action"]
    ) -> tuple[Float[Tensor, "batch state"], Float[Tensor, " batch"]]:
        """The next state [m] and the logarithm of the spread [m]."""
        local, wanted, turn = self.mean.local(states[None], actions[None])
        seen = torch.cat([local.flatten(2), wanted.flatten(2)], dim=-1)
        return self.mean.moved(states[None], local, wanted, turn)[0], self.spread(seen)[0, :, 0]

    def prediction(
        self, states: Float[Tensor, "batch state"], actions: Float[Tensor, "batch action"]
    ) -> tuple[Float[Tensor, "batch state"], Float[Tensor, " batch"]]:
        """The next state and the spread about it [m]."""
        mean, doubt = self(states, actions)
        return mean, doubt.exp()


@dataclass(frozen=True)
class _Lesson:
    """Transitions, as the ensemble predicts them. It ignores the environment, which is any."""

    environment: Environment
    states: Float[np.ndarray, "sample state"]
    actions: Float[np.ndarray, "sample action"]
    said: Prediction

    @classmethod
    def of(
        cls,
        ensemble: LearnedDynamics[Ensemble],
        data: Trajectories,
        sampler: ActionSampler,
        count: int,
        rng: np.random.Generator,
    ) -> _Lesson:
        """So many recorded states, each with a random action."""
        pool = data.states.reshape(-1, data.states.shape[-1])
        states = pool[rng.integers(len(pool), size=count)]
        actions = sampler.propose(states, rng)
        environment = data.environments[0]
        found, spread = roll_out(ensemble, [environment], np.zeros(count, int), states, actions[:, None])
        said = Prediction(found[:, 1], spread[:, 0])
        return cls(environment, states.astype(np.float32), actions.astype(np.float32), said)

    def difference(self, dynamics: Dynamics) -> float:
        """How far the points of the object are from where the ensemble says, on average [m]."""
        predicted = dynamics.predict(self.environment, self.states, self.actions).mean
        return float(point_error(dynamics.layout, predicted, self.said.mean).mean())


@final
class _Imitating(Task):
    """Mean square error of the next state, each component (grippers, object) once, and of the spread's logarithm.

    The score is the mean distance of a point from where the ensemble says it goes [m]; the spread, which a network of
    its own learns, has no part in it.
    """

    def __init__(self, dynamics: LearnedDynamics[Distilled], lesson: _Lesson, judge: _Lesson) -> None:
        self.module, self._dynamics, self._judge = dynamics.module, dynamics, judge
        doubt = np.log(np.maximum(lesson.said.spread, LEAST_SPREAD_M))
        rows = (lesson.states, lesson.actions, lesson.said.mean, doubt)
        self._rows = [beside(self.module, np.asarray(x, np.float32)) for x in rows]

    def order(self, stage: Stage, rng: np.random.Generator) -> Sequence[Int[np.ndarray, " batch"]]:
        count = len(self._rows[0])
        return np.array_split(rng.permutation(count), max(1, count // stage.batch))

    def loss(self, stage: Stage, indices: Int[np.ndarray, " batch"], rng: np.random.Generator) -> Tensor:
        at = torch.from_numpy(indices).to(device_of(self.module))
        states, actions, mean, doubt = (x[at] for x in self._rows)
        predicted, doubted = self.module(states, actions)
        parts = ((predicted - mean) / UNIT_M).square().split(self._dynamics.layout.parts, dim=-1)
        return torch.stack([part.mean() for part in parts]).sum() + (doubted - doubt).square().mean()

    def score(self) -> float:
        return self._judge.difference(self._dynamics)


def train_distilled(
    ensemble: LearnedDynamics[Ensemble], data: Splits, sampler: ActionSampler, config: DistilledConfig, job: Job
) -> LearnedDynamics[Distilled]:
    """Distil an ensemble on the states of `data` and random actions, and save what comes of it."""
    started, of = time.monotonic(), ensemble.module.config
    module = Distilled(data.layout, of, config, job.seed).to(job.device)
    module.begin_with(ensemble.module)
    dynamics, sizes = LearnedDynamics(module), (config.samples, config.samples // 8, config.samples // 8)
    lesson, judge, test = (
        _Lesson.of(ensemble, getattr(data, name), sampler, size, stream(job.seed, "distilled", name))
        for name, size in zip(("train", "validation", "test"), sizes, strict=True)
    )
    task, key = _Imitating(dynamics, lesson, judge), job.key("distilled", config)
    earlier_s = fit(task, config.stages, job.seed, job.folder, key=key, title="distilled")
    metrics = _metrics(ensemble, dynamics, data, test)
    saved, seconds = Saved(config, of), earlier_s + time.monotonic() - started
    save_model(job, "distilled", of.network, data.layout, saved, module.state_dict(), metrics, seconds)
    return dynamics


def _metrics(
    ensemble: LearnedDynamics[Ensemble], dynamics: LearnedDynamics[Distilled], data: Splits, test: _Lesson
) -> dict[str, float | list[float]]:
    """How far it is from the ensemble after one step and over ten [m], and how far its spread is, as a factor."""
    steps = min(10, data.test.actions.shape[1])
    ours, theirs = (roll_out_all(x, data.test, steps) for x in (dynamics, ensemble))
    spread = dynamics.predict(test.environment, test.states, test.actions).spread
    factor = np.exp(np.abs(np.log(spread / np.maximum(test.said.spread, LEAST_SPREAD_M))).mean())
    by_step = point_error(data.layout, ours, theirs).mean(axis=0, dtype=float)
    return {
        "test_point_difference_m": test.difference(dynamics),
        "test_point_difference_by_step_m": by_step.round(6).tolist(),
        "test_spread_factor": float(factor),
    }


@dataclass(frozen=True)
class Saved:
    """What `config.json` holds: how it was distilled, and how the ensemble is built."""

    distilled: DistilledConfig
    dynamics: DynamicsConfig


def distilled_from(model: ModelFile) -> LearnedDynamics[Distilled]:
    """The dynamics of a model that was read."""
    values: Mapping[str, Any] = model.config["distilled"]
    config = DistilledConfig(**{**values, "stages": stages_from(values["stages"])})
    module = Distilled(model.layout, dynamics_config_from(model.config["dynamics"]), config, 0)
    model.load_into(module)
    return LearnedDynamics(module)
