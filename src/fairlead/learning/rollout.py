"""Predictions of several steps: what a model is trained on, judged by, and labelled with."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Int
from numpy.lib.stride_tricks import sliding_window_view
from torch import Tensor

from fairlead.core.errors import FairleadError
from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome, Trajectories, ended_in
from fairlead.core.roles import Dynamics, Environment
from fairlead.geometry.distance import model_error, point_error
from fairlead.learning.device import CPU

DELTA_PERCENTILE = 90.0
DELTA_STEPS = 10
_ROWS = 2048


@dataclass(frozen=True)
class Splits:
    """A dataset, split at collection by trajectory and scene."""

    train: Trajectories
    validation: Trajectories
    test: Trajectories

    def __post_init__(self) -> None:
        for name in ("train", "validation", "test"):
            if not len(getattr(self, name)):
                raise FairleadError(f"the {name} split has no trajectories: collect more")

    @property
    def layout(self) -> StateLayout:
        """How to read a state."""
        return self.train.layout


def roll_out(
    dynamics: Dynamics,
    environments: Sequence[Environment],
    scene: Int[np.ndarray, " batch"],
    starts: Float[np.ndarray, "batch state"],
    actions: Float[np.ndarray, "batch steps action"],
) -> tuple[Float32[np.ndarray, "batch steps_and_one state"], Float32[np.ndarray, "batch steps"]]:
    """Feed the mean prediction back: s_hat^0 = s^0, s_hat^{t+1} = h(E, s_hat^t, a^t). States, and spreads [m].

    Row n is rolled out in environments[scene[n]].
    """
    batch, steps = actions.shape[:2]
    states = np.empty((batch, steps + 1, starts.shape[1]), np.float32)
    spread = np.empty((batch, steps), np.float32)
    states[:, 0] = starts
    for low in range(0, batch, _ROWS):
        rows = slice(low, low + _ROWS)
        for step in range(steps):
            found = dynamics.predict_each(environments, scene[rows], states[rows, step], actions[rows, step])
            states[rows, step + 1], spread[rows, step] = found.mean, found.spread
    return states, spread


def roll_out_all(dynamics: Dynamics, data: Trajectories, steps: int) -> Float32[np.ndarray, "trajectory steps state"]:
    """Predicted states 1 .. steps of every trajectory from its start, each in its own environment."""
    states, _ = roll_out(dynamics, data.environments, data.scene, data.states[:, 0], data.actions[:, :steps])
    return states[:, 1:]


class RolloutErrors(NamedTuple):
    """d [m] and the error per point [m] at each step of rollouts, and which of them count."""

    d: Float[np.ndarray, "rollout step"]
    points: Float[np.ndarray, "rollout step"]
    counted: Bool[np.ndarray, "rollout step"]


def rollout_errors(dynamics: Dynamics, data: Trajectories, leave_out: Collection[ActionOutcome] = ()) -> RolloutErrors:
    """The errors at the first ten steps of rollouts from every trajectory's start.

    What precedes the first action whose outcome is in `leave_out` counts.
    """
    steps = min(DELTA_STEPS, data.actions.shape[1])
    predicted = roll_out_all(dynamics, data, steps)
    actual = data.states[:, 1 : steps + 1]
    lost = np.logical_or.accumulate(ended_in(data.outcomes[:, :steps], leave_out), axis=1)
    return RolloutErrors(
        model_error(data.layout, predicted, actual), point_error(data.layout, predicted, actual), ~lost
    )


def dynamics_metrics(dynamics: Dynamics, data: Splits, leave_out: Collection[ActionOutcome] = ()) -> dict[str, object]:
    """Errors per point on each split, by step on test; delta, the 90th percentile of d on validation [m].

    `leave_out` as in `rollout_errors`.
    """
    found = {name: rollout_errors(dynamics, getattr(data, name), leave_out) for name in ("train", "validation", "test")}
    steps = zip(found["test"].points.T, found["test"].counted.T, strict=True)
    d, _, counted = found["validation"]
    return {
        **{f"{name}_point_error_m": float(of.points[of.counted].mean()) for name, of in found.items()},
        "test_point_error_by_step_m": [round(float(x[kept].mean()), 6) for x, kept in steps if kept.any()],
        "delta_m": float(np.percentile(d[counted], DELTA_PERCENTILE)),
        "trajectories": {name: len(getattr(data, name)) for name in found},
    }


class Windows:
    """Every run of `horizon` steps in a dataset, as tensors on a device, by (trajectory, first step).

    Runs with an action whose outcome is in `leave_out` are left out.
    """

    def __init__(
        self, data: Trajectories, device: torch.device = CPU, leave_out: Collection[ActionOutcome] = ()
    ) -> None:
        self._wanted = ~ended_in(data.outcomes, leave_out)
        self.states = torch.from_numpy(np.ascontiguousarray(data.states, np.float32)).to(device)
        self.actions = torch.from_numpy(np.ascontiguousarray(data.actions, np.float32)).to(device)
        self.scene = torch.from_numpy(np.ascontiguousarray(data.scene, np.int64))

    def order(
        self, horizon: int, batch: int, members: int, rng: np.random.Generator
    ) -> Sequence[Int[np.ndarray, "member batch 2"]]:
        """Minibatches of one pass over the windows; each member sees the same windows in an order of its own."""
        runs = sliding_window_view(self._wanted, min(horizon, self._wanted.shape[1]), axis=1)
        every = np.argwhere(runs.all(axis=-1))
        shuffled = np.stack([every[rng.permutation(len(every))] for _ in range(members)])
        return np.array_split(shuffled, max(1, len(every) // batch), axis=1)

    def at(
        self, indices: Int[np.ndarray, "member batch 2"], horizon: int
    ) -> tuple[
        Float[Tensor, "member batch steps_and_one state"],
        Float[Tensor, "member batch steps action"],
        Int[Tensor, "member batch"],
    ]:
        """States, actions and scenes (these on the processor) of windows."""
        horizon = min(horizon, self.actions.shape[1])
        trajectory, first = torch.from_numpy(indices).unbind(-1)
        scene, device = self.scene[trajectory], self.states.device
        trajectory = trajectory.to(device)
        steps = (first[..., None] + torch.arange(horizon + 1)).to(device)
        return (
            self.states[trajectory[..., None], steps],
            self.actions[trajectory[..., None], steps[..., :-1]],
            scene,
        )
