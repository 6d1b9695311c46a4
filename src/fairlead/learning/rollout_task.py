"""What both kinds of dynamics are fitted by: the loss of Eq. 5 over several predicted steps."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import final

import numpy as np
import torch
from jaxtyping import Int
from torch import Tensor, nn

from fairlead.core.records import ActionOutcome
from fairlead.core.roles import Dynamics
from fairlead.learning.device import beside, device_of
from fairlead.learning.fit import Stage, Task
from fairlead.learning.networks import UNIT_M
from fairlead.learning.rollout import Splits, Windows, rollout_errors


@final
class RolloutTask(Task):
    """Fits a step function to trajectories by the loss of Eq. 5, as a mean over all predicted steps.

    Each state component (grippers, object) weighs once, by its mean square error. The score is the validation error per
    point [m] over ten-step rollouts. `step` makes the next states of states, actions and scenes, with a stream for what
    it draws; actions whose outcome is in `leave_out` are not learned from, and the score is of what precedes them.
    """

    def __init__(
        self,
        module: nn.Module,
        step: Callable[[Tensor, Tensor, Tensor, np.random.Generator], Tensor],
        dynamics: Dynamics,
        data: Splits,
        members: int = 1,
        mirror: bool = False,
        leave_out: Collection[ActionOutcome] = (),
    ) -> None:
        self.module, self._step, self._dynamics = module, step, dynamics
        self._data, self._members, self._mirror, self._leave_out = data, members, mirror, leave_out
        self._windows = Windows(data.train, device_of(module), leave_out)

    def order(self, stage: Stage, rng: np.random.Generator) -> Sequence[Int[np.ndarray, "member batch 2"]]:
        return self._windows.order(stage.horizon, stage.batch, self._members, rng)

    def loss(self, stage: Stage, indices: Int[np.ndarray, "member batch 2"], rng: np.random.Generator) -> Tensor:
        states, actions, scene = self._windows.at(indices, stage.horizon)
        if self._mirror:
            flip = beside(self.module, 1 - 2 * rng.integers(0, 2, indices.shape[:2]).astype(np.float32))
            states, actions = (_mirrored(x, flip) for x in (states, actions))
        total = states.new_zeros(())
        current = states[:, :, 0]
        for step in range(actions.shape[2]):
            current = self._step(current, actions[:, :, step], scene, rng)
            error = ((current - states[:, :, step + 1]) / UNIT_M).square()
            for part in error.split(self._data.layout.parts, dim=-1):
                total = total + part.mean()
        return total / actions.shape[2]

    def score(self) -> float:
        found = rollout_errors(self._dynamics, self._data.validation, self._leave_out)
        return float(found.points[found.counted].mean())


def _mirrored(vectors: Tensor, flip: Tensor) -> Tensor:
    """World y changes sign where flip is -1."""
    sign = torch.stack([torch.ones_like(flip), flip, torch.ones_like(flip)], dim=-1)
    return vectors * sign.repeat(1, 1, vectors.shape[-1] // 3)[:, :, None]
