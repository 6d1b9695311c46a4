"""What to do where no prediction can be trusted (paper, "Evaluating stuck states and learning recovery actions")."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from fairlead.core.errors import FairleadError
from fairlead.core.roles import ActionSampler, Dynamics, Environment, RecoveryPolicy, TransitionCheck
from fairlead.core.streams import stream
from fairlead.learning.device import beside, seeded
from fairlead.learning.fit import Stage, Task, fit, stages_from
from fairlead.learning.labels import CUT_BY_ARMS
from fairlead.learning.metrics import log_loss
from fairlead.learning.model_files import Job, ModelFile, save_model
from fairlead.learning.recovery_networks import ChainRecovery, FrozenRecovery, RecoveryNetwork
from fairlead.learning.rollout import Splits
from fairlead.learning.stuck import RecoveryExamples, recovery_examples
from fairlead.learning.trust import LearnedCheck, build_network, probabilities, trust_config_from
from fairlead.learning.trust_network import Inputs, TrustConfig, TrustNetwork

ENOUGH = 50


@dataclass(frozen=True)
class RecoveryConfig:
    """How recovery is learned.

    Args:
        samples: N_rs, actions sampled to see whether a state is stuck, and to choose from.
        hidden: units of each of the two hidden layers of the paper's head (`voxel`).
        limit: most transitions of a split that are examined; a uniform sample of trajectories beyond it.
        discount: of what is reached later in the trajectory; 0 labels by the next state alone (the paper's).
        stages: minibatches of stuck states.
        patience: epochs without improvement after which a stage ends.
    """

    samples: int = 32
    hidden: int = 128
    limit: int = 100_000
    discount: float = 0.0
    stages: tuple[Stage, ...] = (Stage(10, 64, 1e-3),)
    patience: int = 10

    def __post_init__(self) -> None:
        if min(self.samples, self.hidden, self.limit, len(self.stages)) < 1:
            raise FairleadError("recovery: samples, hidden, limit and the number of stages must be positive")
        if not 0 <= self.discount < 1:
            raise FairleadError(f"recovery: discount {self.discount}: at least 0 and below 1 is needed")


@dataclass(frozen=True)
class _Saved:
    """A recovery model holds the classifier whose layers it took over."""

    recovery: RecoveryConfig
    trust: TrustConfig


_NETWORKS: dict[str, Callable[[Any, RecoveryConfig], RecoveryNetwork]] = {
    "sdf": lambda trust, config: ChainRecovery(trust),
    "voxel": lambda trust, config: FrozenRecovery(trust, config.hidden),
}
"""By the network of the classifier: called with it, and with how recovery is learned."""


@final
class RecoveryTask(Task):
    """Binary cross-entropy with soft labels: every label from 0 to 1 weighs the same."""

    def __init__(
        self, module: RecoveryNetwork, train: tuple[Inputs, np.ndarray], validation: tuple[Inputs, np.ndarray]
    ) -> None:
        self.module: nn.Module = module
        self._network, self._train, self._validation = module, train, validation
        module.standardise(train[0], len(train[1]))

    def order(self, stage: Stage, rng: np.random.Generator) -> Sequence[Int[np.ndarray, " row"]]:
        count = len(self._train[1])
        return np.array_split(rng.permutation(count), max(1, count // stage.batch))

    def loss(self, stage: Stage, indices: Int[np.ndarray, " row"], rng: np.random.Generator) -> Tensor:
        inputs, share = self._train
        target = beside(self.module, share[indices].astype(np.float32))
        logits = self._network(*self._network.augment(inputs(indices), rng))
        return nn.functional.binary_cross_entropy_with_logits(logits, target)

    def score(self) -> float:
        inputs, share = self._validation
        return log_loss(probabilities(self._network, inputs, len(share)), share)


@final
class LearnedRecovery(RecoveryPolicy):
    """The most promising of N_rs random actions. Without a network (nothing to learn from): a random one."""

    def __init__(self, network: RecoveryNetwork | None, sampler: ActionSampler, samples: int) -> None:
        self._network, self._sampler, self._samples = network, sampler, samples

    def choose(
        self,
        environment: Environment,
        states: Float[np.ndarray, "batch state"],
        rng: np.random.Generator,
    ) -> Float[np.ndarray, "batch action"]:
        if self._network is None:
            return self._sampler.propose(states, rng)
        actions = self._sampler.propose(np.repeat(states, self._samples, axis=0), rng)
        actions = actions.reshape(len(states), self._samples, -1)
        score = self.probability(environment, states, actions)
        allowed = self._sampler.allows(np.repeat(states, self._samples, axis=0), actions.reshape(score.size, -1))
        best = np.where(allowed.reshape(score.shape), score, -1.0).argmax(axis=1)
        return actions[np.arange(len(states)), best]

    def probability(
        self,
        environment: Environment,
        states: Float[np.ndarray, "batch state"],
        actions: Float[np.ndarray, "batch sample action"],
    ) -> Float[np.ndarray, "batch sample"]:
        """How likely each of a state's actions is to lead out of it; without a network, one half."""
        if self._network is None:
            return np.full(actions.shape[:2], 0.5)
        with torch.inference_mode():
            logits = self._network.judge(environment, states, actions)
        return torch.sigmoid(logits).cpu().numpy().reshape(actions.shape[:2])


def train_recovery(
    dynamics: Dynamics,
    check: LearnedCheck,
    trusted: TransitionCheck,
    sampler: ActionSampler,
    data: Splits,
    config: RecoveryConfig,
    job: Job,
) -> LearnedRecovery:
    """Find stuck states in phase 2 data, learn which actions lead out of them, and save that.

    `trusted` is what planning asks, and says which states are stuck: `check`, perhaps with something on top of it. The
    features of a state are those of `check`.
    """
    started, trust = time.monotonic(), check.network
    found: dict[str, RecoveryExamples] = {}
    for name in ("train", "validation", "test"):
        found[name] = recovery_examples(
            dynamics, trusted, sampler, getattr(data, name), config.samples, config.limit, config.discount,
            stream(job.seed, "recovery", name), CUT_BY_ARMS if trust.config.reach_known else (),
        )  # fmt: skip
    metrics: dict[str, Any] = {"trained": len(found["train"]) >= ENOUGH and len(found["validation"]) > 0}
    metrics |= {name: examples.counts() for name, examples in found.items()}
    network, earlier_s = None, 0.0
    if metrics["trained"]:
        network = _build(trust, config, job.seed).to(job.device)
        inputs = {name: network.prepare(getattr(data, name).environments, e) for name, e in found.items() if len(e)}
        sets = [(inputs[name], found[name].share) for name in ("train", "validation")]
        earlier_s = fit(RecoveryTask(network, *sets), config.stages, job.seed, job.folder,
                        key=job.key("recovery", config), patience=config.patience, title="recovery")  # fmt: skip
        for name, x in inputs.items():
            metrics[name]["log_loss"] = log_loss(probabilities(network, x, len(found[name])), found[name].share)
    else:
        metrics["why"] = f"fewer than {ENOUGH} stuck states in training data, or none in validation: acts at random"
    saved, seconds = _Saved(config, trust.config), earlier_s + time.monotonic() - started
    tensors = {} if network is None else network.state_dict()
    save_model(job, "recovery", trust.config.network, trust.layout, saved, tensors, metrics, seconds)
    return LearnedRecovery(network, sampler, config.samples)


def _build(trust: TrustNetwork, config: RecoveryConfig, seed: int) -> RecoveryNetwork:
    return seeded(lambda: _NETWORKS[trust.config.network](trust, config), seed, "recovery")


def recovery_from(model: ModelFile, sampler: ActionSampler) -> LearnedRecovery:
    """The recovery policy of a model that was read."""
    values = model.config["recovery"]
    config = RecoveryConfig(**{**values, "stages": stages_from(values["stages"])})
    network = None
    if model.metrics["trained"]:
        network = _build(build_network(model.layout, trust_config_from(model.config["trust"]), 0), config, 0)
        model.load_into(network)
    return LearnedRecovery(network, sampler, config.samples)
