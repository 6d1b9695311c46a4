"""The one training loop: minibatches in a seeded order, Adam, early stopping on validation, resumable to the bit."""

from __future__ import annotations

import csv
import io
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Int
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from torch import Tensor, nn

from fairlead.core.artifacts import write_atomic
from fairlead.core.errors import FairleadError
from fairlead.core.streams import stream
from fairlead.learning.checkpoint import Snapshot, read_snapshot, write_snapshot

CHECKPOINT = "checkpoint.safetensors"
LAST_RATE = 0.01


@dataclass(frozen=True)
class Stage:
    """A part of training with settings of its own.

    Args:
        epochs: passes over the data, at most (early stopping may end it before).
        batch: examples in a minibatch.
        rate: Adam's rate at the start; it falls along half a cosine to a hundredth.
        horizon: how many steps a dynamics model predicts in its loss; other models ignore it.
    """

    epochs: int
    batch: int
    rate: float = 1e-3
    horizon: int = 1

    def __post_init__(self) -> None:
        if min(self.epochs, self.batch, self.horizon) < 1 or not self.rate > 0:
            raise FairleadError(f"a training stage needs positive epochs, batch, rate and horizon, got {self}")

    def rate_at(self, progress: float) -> float:
        """The learning rate when a fraction `progress` of the stage is done."""
        return self.rate * (LAST_RATE + (1 - LAST_RATE) * (1 + math.cos(math.pi * progress)) / 2)


def stages_from(values: Sequence[Mapping[str, Any]]) -> tuple[Stage, ...]:
    """The stages of a configuration read from JSON."""
    return tuple(Stage(**stage) for stage in values)


class Task(ABC):
    """What is fitted: a module, the order of the minibatches, their loss, and the score on validation data."""

    module: nn.Module

    @abstractmethod
    def order(self, stage: Stage, rng: np.random.Generator) -> Sequence[Int[np.ndarray, "*index"]]:
        """The minibatches of one epoch, as indices into the training examples."""

    @abstractmethod
    def loss(self, stage: Stage, indices: Int[np.ndarray, "*index"], rng: np.random.Generator) -> Tensor:
        """The loss of one minibatch; `rng` is for augmentation."""

    @abstractmethod
    def score(self) -> float:
        """How bad the module is on validation data: the weights with the least score are kept."""


@dataclass
class _State:
    """Where training stands. Everything that the rest of training depends on, besides module and optimiser."""

    stage: int = 0
    epoch: int = 0
    best: float = math.inf
    best_epoch: int = -1
    history: list[dict[str, float]] = field(default_factory=list)


def fit(
    task: Task,
    stages: Sequence[Stage],
    seed: int,
    folder: Path,
    *,
    key: str = "",
    patience: int = 30,
    checkpoint_s: float = 20.0,
    title: str = "training",
) -> float:
    """Fit `task.module`, and leave the weights with the best validation score in it.

    A checkpoint in `folder` is written at the end of an epoch, every `checkpoint_s` seconds at most, and when training
    is interrupted; if one with the same `key` is there, training goes on from it to exactly the same weights (on a CPU,
    with as many threads). The curves, one row an epoch, are written as `curves.csv` and `curves.png`.

    Returns how long epochs took that were done already [s].

    Raises:
        ArtifactError: the checkpoint belongs to another `key`.
        FairleadError: the loss or the score is no longer finite.
    """
    path, state = folder / CHECKPOINT, _State()
    best = {name: value.clone() for name, value in task.module.state_dict().items()}
    optimiser = _adam(task.module)
    if path.exists():
        snapshot = read_snapshot(path, key)
        state, best = _State(**snapshot.scalars), snapshot.best
        snapshot.restore(task.module, optimiser)
    finished = Snapshot.take(task.module, optimiser, best, vars(state))
    saved, earlier_s = time.monotonic(), sum(row["seconds"] for row in state.history)
    with _progress() as progress:
        bar = progress.add_task(title, total=sum(stage.epochs for stage in stages), completed=len(state.history))
        while state.stage < len(stages):
            stage = stages[state.stage]
            try:
                row = _epoch(task, stage, state, optimiser, stream(seed, "fit", state.stage, state.epoch))
                row["score"] = task.score()
            except KeyboardInterrupt:
                write_snapshot(path, key, finished)
                raise
            if not math.isfinite(row["score"]):
                raise FairleadError(f"the score became {row['score']} in stage {state.stage + 1}: lower its rate "
                                    f"(now {stage.rate:g})")  # fmt: skip
            state.history.append(row)
            if row["score"] < state.best:
                state.best, state.best_epoch = row["score"], len(state.history) - 1
                best = {name: value.clone() for name, value in task.module.state_dict().items()}
            state.epoch += 1
            since = min(state.epoch, len(state.history) - 1 - state.best_epoch)
            progress.update(bar, advance=1, description=f"{title} {state.best:.4g}")
            if state.epoch == stage.epochs or since >= patience:
                progress.update(bar, advance=stage.epochs - state.epoch)
                state.stage, state.epoch = state.stage + 1, 0
                task.module.load_state_dict(best)
                optimiser = _adam(task.module)
            finished = Snapshot.take(task.module, optimiser, best, vars(state))
            if time.monotonic() - saved >= checkpoint_s:
                write_snapshot(path, key, finished)
                saved = time.monotonic()
    write_snapshot(path, key, finished)
    write_curves(folder, title, state.history)
    return earlier_s


def _adam(module: nn.Module) -> torch.optim.Adam:
    return torch.optim.Adam([parameter for parameter in module.parameters() if parameter.requires_grad])


def _epoch(
    task: Task, stage: Stage, state: _State, optimiser: torch.optim.Adam, rng: np.random.Generator
) -> dict[str, float]:
    """One pass over the data; its row of the curves."""
    started, total = time.monotonic(), 0.0
    batches = task.order(stage, rng)
    task.module.train()
    for number, indices in enumerate(batches):
        rate = stage.rate_at((state.epoch + number / len(batches)) / stage.epochs)
        for group in optimiser.param_groups:
            group["lr"] = rate
        optimiser.zero_grad(set_to_none=True)
        loss = task.loss(stage, indices, rng)
        loss.backward()
        optimiser.step()
        total += loss.item()
    task.module.eval()
    if not math.isfinite(total):
        raise FairleadError(f"the loss became {total} in stage {state.stage + 1}: lower its rate (now {stage.rate:g})")
    seconds = time.monotonic() - started
    return {"stage": state.stage, "epoch": state.epoch, "loss": total / len(batches), "seconds": round(seconds, 3)}


def _progress() -> Progress:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    columns += (TextColumn("epochs"), TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn())
    return Progress(*columns, console=Console(stderr=True))


def write_curves(folder: Path, title: str, history: Sequence[Mapping[str, float]]) -> None:
    """The curves of training as data (`curves.csv`) and as a picture (`curves.png`)."""
    from matplotlib.figure import Figure

    text = io.StringIO()
    writer = csv.DictWriter(text, list(history[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(history)
    write_atomic(folder / "curves.csv", text.getvalue())
    figure = Figure(figsize=(7, 3), layout="constrained")
    for axes, name in zip(figure.subplots(1, 2), ("loss", "score"), strict=True):
        axes.semilogy([row[name] for row in history])
        axes.set(title=f"{title}: " + ("training loss" if name == "loss" else "validation score"), xlabel="epoch")
    picture = io.BytesIO()
    figure.savefig(picture, dpi=110)
    write_atomic(folder / "curves.png", picture.getvalue())
