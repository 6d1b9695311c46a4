"""What to do where no prediction can be trusted (paper, "Evaluating stuck states and learning recovery actions")."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
import torch
from jaxtyping import Float, Float32, Int
from torch import Tensor, nn

from fairlead.core.errors import FairleadError
from fairlead.core.records import Trajectories
from fairlead.core.roles import ActionSampler, Dynamics, Environment, RecoveryPolicy, TransitionCheck
from fairlead.core.streams import stream, stream_seed
from fairlead.geometry.frames import local_origin
from fairlead.learning.fit import Stage, Task, fit
from fairlead.learning.metrics import log_loss
from fairlead.learning.model_files import Job, ModelFile, save_model
from fairlead.learning.rollout import Splits
from fairlead.learning.stuck import RecoveryExamples, recovery_examples
from fairlead.learning.trust import LearnedCheck, build_network, trust_config_from
from fairlead.learning.trust_network import TrustConfig, TrustNetwork

ENOUGH = 50


@dataclass(frozen=True)
class RecoveryConfig:
    """How recovery is learned.

    Args:
        samples: N_rs, actions sampled to see whether a state is stuck, and to choose from.
        hidden: units of each of the two hidden layers.
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


@final
class RecoveryHead(nn.Module):
    """[frozen features, world state, local state, local action] -> BatchNorm -> hidden -> hidden -> logit."""

    def __init__(self, inputs: int, hidden: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.BatchNorm1d(inputs),
            nn.Linear(inputs, hidden),
            nn.ReLU(),
            nn.Linear(hidden, hidden),
            nn.ReLU(),
            nn.Linear(hidden, 1),
        )

    def forward(self, features: Float[Tensor, "batch input"]) -> Float[Tensor, " batch"]:
        """The logit of the probability that the action recovers."""
        return self.layers(features).squeeze(-1)


def state_features(
    trust: TrustNetwork, environment: Environment, states: Float[np.ndarray, "batch state"]
) -> Float32[np.ndarray, "batch feature"]:
    """What recovery sees of a state: the classifier's features, frozen, and the world-frame and local vectors."""
    local = states - np.tile(local_origin(trust.layout, states), trust.layout.state_size // 3)
    with torch.inference_mode():
        seen = trust.frozen(environment, states)
    return np.concatenate([seen, states, local], axis=1, dtype=np.float32)


def with_actions(
    trust: TrustNetwork,
    features: Float32[np.ndarray, "batch feature"],
    states: Float[np.ndarray, "batch state"],
    actions: Float[np.ndarray, "batch action"],
) -> Float[Tensor, "batch input"]:
    """The inputs of the head: a state's features and a local action in each row."""
    local = actions - np.tile(local_origin(trust.layout, states), len(trust.layout.grippers))
    return torch.from_numpy(np.concatenate([features, local], axis=1, dtype=np.float32))


def head_inputs(trust: TrustNetwork, data: Trajectories, examples: RecoveryExamples) -> Float[Tensor, "n input"]:
    """The inputs of the head for every example, each in its own environment."""
    parts = [
        (rows, state_features(trust, data.environments[scene], examples.states[rows]))
        for scene in np.unique(examples.scene)
        for rows in [np.flatnonzero(examples.scene == scene)]
    ]
    features = np.empty((len(examples), parts[0][1].shape[1]), np.float32)
    for rows, found in parts:
        features[rows] = found
    return with_actions(trust, features, examples.states, examples.actions)


@final
class RecoveryTask(Task):
    """Binary cross-entropy with soft labels: every label from 0 to 1 weighs the same."""

    def __init__(
        self, module: RecoveryHead, train: tuple[Tensor, np.ndarray], validation: tuple[Tensor, np.ndarray]
    ) -> None:
        self.module, self._train, self._validation = module, train, validation

    def order(self, stage: Stage, rng: np.random.Generator) -> Sequence[Int[np.ndarray, " row"]]:
        count = len(self._train[1])
        return np.array_split(rng.permutation(count), max(1, count // stage.batch))

    def loss(self, stage: Stage, indices: Int[np.ndarray, " row"], rng: np.random.Generator) -> Tensor:
        inputs, share = self._train
        target = torch.from_numpy(share[indices].astype(np.float32))
        return nn.functional.binary_cross_entropy_with_logits(self.module(inputs[torch.from_numpy(indices)]), target)

    def score(self) -> float:
        return log_loss(probabilities(self.module, self._validation[0]), self._validation[1])


def probabilities(head: nn.Module, inputs: Float[Tensor, "batch input"]) -> Float[np.ndarray, " batch"]:
    """The probability that each action recovers."""
    with torch.inference_mode():
        return torch.sigmoid(head(inputs)).numpy()


@final
class LearnedRecovery(RecoveryPolicy):
    """The most promising of N_rs random actions. Without a head (nothing to learn from): a random one."""

    def __init__(self, trust: TrustNetwork, head: RecoveryHead | None, sampler: ActionSampler, samples: int) -> None:
        self._trust, self._head, self._sampler, self._samples = trust, head, sampler, samples

    def choose(
        self,
        environment: Environment,
        states: Float[np.ndarray, "batch state"],
        rng: np.random.Generator,
    ) -> Float[np.ndarray, "batch action"]:
        if self._head is None:
            return self._sampler.propose(states, rng)
        actions = self._sampler.propose(np.repeat(states, self._samples, axis=0), rng)
        actions = actions.reshape(len(states), self._samples, -1)
        best = self.probability(environment, states, actions).argmax(axis=1)
        return actions[np.arange(len(states)), best]

    def probability(
        self,
        environment: Environment,
        states: Float[np.ndarray, "batch state"],
        actions: Float[np.ndarray, "batch sample action"],
    ) -> Float[np.ndarray, "batch sample"]:
        """How likely each of a state's actions is to lead out of it; without a head, one half."""
        if self._head is None:
            return np.full(actions.shape[:2], 0.5)
        samples = actions.shape[1]
        features = np.repeat(state_features(self._trust, environment, states), samples, axis=0)
        repeated = np.repeat(states, samples, axis=0)
        inputs = with_actions(self._trust, features, repeated, actions.reshape(len(repeated), -1))
        return probabilities(self._head, inputs).reshape(len(states), samples)


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
        split, rng, c = getattr(data, name), stream(job.seed, "recovery", name), config
        found[name] = recovery_examples(dynamics, trusted, sampler, split, c.samples, c.limit, c.discount, rng)
    metrics: dict[str, Any] = {"trained": len(found["train"]) >= ENOUGH and len(found["validation"]) > 0}
    metrics |= {name: examples.counts() for name, examples in found.items()}
    head = None
    if metrics["trained"]:
        inputs = {name: head_inputs(trust, getattr(data, name), e) for name, e in found.items() if len(e)}
        head = _build_head(inputs["train"].shape[1], config, job.seed)
        sets = [(inputs[name], found[name].share) for name in ("train", "validation")]
        fit(RecoveryTask(head, *sets), config.stages, job.seed, job.folder,
            key=job.key("recovery", config), patience=config.patience, title="recovery")  # fmt: skip
        for name, x in inputs.items():
            metrics[name]["log_loss"] = log_loss(probabilities(head, x), found[name].share)
    else:
        metrics["why"] = f"fewer than {ENOUGH} stuck states in training data, or none in validation: acts at random"
    parts = {"trust": trust, **({} if head is None else {"head": head})}
    tensors = {f"{part}.{name}": x for part, module in parts.items() for name, x in module.state_dict().items()}
    saved, seconds = _Saved(config, trust.config), time.monotonic() - started
    save_model(job, "recovery", trust.config.network, trust.layout, saved, tensors, metrics, seconds)
    return LearnedRecovery(trust, head, sampler, config.samples)


def _build_head(inputs: int, config: RecoveryConfig, seed: int) -> RecoveryHead:
    with torch.random.fork_rng(devices=[]):  # as in trust.build_network
        torch.manual_seed(stream_seed(seed, "recovery", "weights"))
        return RecoveryHead(inputs, config.hidden).eval()


def recovery_from(model: ModelFile, sampler: ActionSampler) -> LearnedRecovery:
    """The recovery policy of a model that was read."""
    values = model.config["recovery"]
    config = RecoveryConfig(**{**values, "stages": tuple(Stage(**stage) for stage in values["stages"])})
    trust = build_network(model.layout, trust_config_from(model.config["trust"]), 0)
    model.load_into(trust, "trust.")
    head = None
    if model.metrics["trained"]:
        head = _build_head(len(model.tensors["head.layers.0.weight"]), config, 0)
        model.load_into(head, "head.")
    return LearnedRecovery(trust, head, sampler, config.samples)
