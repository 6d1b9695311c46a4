"""The trust classifier: trained on labelled transitions, then one of the roles (paper, "Learning the classifier")."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self, final

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from fairlead.core.errors import FairleadError
from fairlead.core.layout import StateLayout
from fairlead.core.records import Trajectories, Transitions
from fairlead.core.roles import Dynamics, Environment, TransitionCheck
from fairlead.core.streams import stream
from fairlead.learning.device import CPU, beside, seeded
from fairlead.learning.fit import Stage, Task, fit, stages_from
from fairlead.learning.labels import CUT_BY_ARMS, RULES, Examples, label
from fairlead.learning.metrics import balanced_log_loss, best_threshold, classification
from fairlead.learning.model_files import Job, ModelFile, save_model
from fairlead.learning.rollout import Splits
from fairlead.learning.trust_network import Inputs, TrustConfig, TrustNetwork
from fairlead.learning.trust_sdf import SdfTrust
from fairlead.learning.trust_voxel import VoxelTrust
from fairlead.learning.voxels import VoxelGrid

HELD_OUT = 15_000
"""Most examples of validation and of test: of the same data, delta and rule the same ones for every network."""
_BUILDERS: dict[str, Callable[[StateLayout, TrustConfig], TrustNetwork]] = {"sdf": SdfTrust, "voxel": VoxelTrust}
_ROWS = 512


def build_network(layout: StateLayout, config: TrustConfig, seed: int) -> TrustNetwork:
    """A network with weights derived from `seed`, in evaluation mode."""
    return seeded(lambda: _BUILDERS[config.network](layout, config), seed, "trust")


@final
class LearnedCheck(TransitionCheck):
    """A trained classifier as the role that planning asks."""

    def __init__(self, network: TrustNetwork) -> None:
        self.network = network

    def encode(
        self, environment: Environment, states: Float[np.ndarray, "batch state"]
    ) -> Float[np.ndarray, "batch feature"]:
        with torch.inference_mode():
            return self.network.encode(environment, states)

    def probability(
        self,
        environment: Environment,
        transitions: Transitions,
        encodings: Float[np.ndarray, "batch feature"],
        next_encodings: Float[np.ndarray, "batch feature"],
    ) -> Float[np.ndarray, " batch"]:
        with torch.inference_mode():
            return torch.sigmoid(self.network.judge(transitions, encodings, next_encodings)).cpu().numpy()


@final
class TrustTask(Task):
    """Binary cross-entropy on balanced minibatches; the score is the balanced cross-entropy on validation."""

    def __init__(
        self, module: TrustNetwork, train: tuple[Inputs, np.ndarray], validation: tuple[Inputs, np.ndarray]
    ) -> None:
        self.module: nn.Module = module
        self._network, self._validation = module, validation
        self._inputs, self._labels = train
        module.standardise(self._inputs, len(self._labels))

    def order(self, stage: Stage, rng: np.random.Generator) -> Sequence[Int[np.ndarray, " row"]]:
        """Half of each minibatch is reliable and half is not: the rarer class is oversampled."""
        return balanced_order(self._labels, stage.batch, rng)

    def loss(self, stage: Stage, indices: Int[np.ndarray, " row"], rng: np.random.Generator) -> Tensor:
        inputs = self._network.augment(self._inputs(indices), rng)
        target = beside(self.module, self._labels[indices].astype(np.float32))
        return nn.functional.binary_cross_entropy_with_logits(self._network(*inputs), target)

    def score(self) -> float:
        inputs, labels = self._validation
        return balanced_log_loss(probabilities(self._network, inputs, len(labels)), labels)


def balanced_order(
    labels: Float[np.ndarray, " example"], batch: int, rng: np.random.Generator
) -> Sequence[Int[np.ndarray, " row"]]:
    """Minibatches of one pass over the commoner class, each with as many examples of the rarer one."""
    classes = [rng.permutation(np.flatnonzero(labels == value)) for value in (False, True)]
    longest = max(map(len, classes))
    columns = [np.concatenate([rows, rng.choice(rows, longest - len(rows))]) for rows in classes]
    return np.array_split(np.stack(columns, axis=1).reshape(-1), max(1, 2 * longest // batch))


def probabilities(network: nn.Module, inputs: Inputs, count: int) -> Float[np.ndarray, " example"]:
    """What the network says of each of `count` examples."""
    with torch.inference_mode():
        rows = np.array_split(np.arange(count), max(1, count // _ROWS))
        return torch.sigmoid(torch.cat([network(*inputs(chunk)) for chunk in rows])).cpu().numpy()


@dataclass(frozen=True)
class Labelled:
    """A dataset labelled at delta [m]: its splits under a rule, and its training data under the other rules."""

    delta: float
    rule: str
    splits: Mapping[str, Examples]
    others: Mapping[str, Examples]

    @classmethod
    def by(cls, dynamics: Dynamics, data: Splits, delta: float, config: TrustConfig) -> Self:
        """Labelled by the predictions of `dynamics`, for a classifier of that configuration but for its delta."""
        leave_out = CUT_BY_ARMS if config.reach_known else ()

        def labelled(split: Trajectories, rule: str) -> Examples:
            return label(dynamics, split, delta, rule, leave_out=leave_out)

        splits = {name: labelled(getattr(data, name), config.rule) for name in ("train", "validation", "test")}
        others = {rule: labelled(data.train, rule) for rule in RULES if rule != config.rule}
        return cls(delta, config.rule, splits, others)

    def at(self, delta: float) -> Self:
        """The same at a smaller delta, without rolling out again."""
        splits, others = ({name: e.at(delta) for name, e in of.items()} for of in (self.splits, self.others))
        return type(self)(delta, self.rule, splits, others)


def train_trust(dynamics: Dynamics, data: Splits, delta: float, config: TrustConfig, job: Job) -> LearnedCheck:
    """Label the data with the predictions of `dynamics` at `delta` [m], train a classifier and save it."""
    started = time.monotonic()
    return fit_trust(Labelled.by(dynamics, data, delta, config), config, job, started)


def fit_trust(labelled: Labelled, config: TrustConfig, job: Job, started: float | None = None) -> LearnedCheck:
    """Train a classifier on labelled data and save it; its wall time counts from `started`, or from now."""
    started = time.monotonic() if started is None else started
    delta, whole = labelled.delta, labelled.splits
    limits = {"train": config.limit, "validation": HELD_OUT, "test": HELD_OUT}
    examples = {name: e.sample(limits[name], stream(job.seed, "examples", name)) for name, e in whole.items()}
    layout, labels = whole["train"].layout, examples["train"].labels
    if labels.all() or not labels.any():
        only = "reliable" if labels.all() else "unreliable"
        raise FairleadError(f"every training example is {only}: nothing to learn; collect more, or change delta")
    network = build_network(layout, config, job.seed).to(job.device)
    prepared = {name: (network.prepare(e), e.labels) for name, e in examples.items()}
    task = TrustTask(network, prepared["train"], prepared["validation"])
    key, title = job.key(f"trust at {delta!r}", config), f"trust ({config.network})"
    earlier_s = fit(task, config.stages, job.seed, job.folder, key=key, patience=config.patience, title=title)
    metrics: dict[str, Any] = {"delta_m": delta, "rule": labelled.rule}
    for name, (inputs, actual) in prepared.items():
        metrics[name] = classification(probabilities(network, inputs, len(actual)), actual)
    metrics.update({f"test_{name}": metrics["test"][name] for name in ("accuracy", "precision", "recall", "auroc")})
    held_out = examples["validation"]
    metrics["spread_threshold_m"] = best_threshold(held_out.transitions.spread, held_out.labels)
    metrics["rules"] = {rule: e.counts() for rule, e in {labelled.rule: whole["train"], **labelled.others}.items()}
    seconds = earlier_s + time.monotonic() - started
    save_model(job, "trust", config.network, layout, config, network.state_dict(), metrics, seconds)
    return LearnedCheck(network)


def trust_config_from(values: dict[str, Any]) -> TrustConfig:
    """A configuration read from JSON."""
    stages, grid = stages_from(values["stages"]), VoxelGrid.read(values["grid"])
    return TrustConfig(**{**values, "stages": stages, "grid": grid})


def check_from(model: ModelFile, device: torch.device = CPU) -> LearnedCheck:
    """The check of a model that was read."""
    network = build_network(model.layout, trust_config_from(model.config), 0)
    model.load_into(network)
    return LearnedCheck(network.to(device))
