"""Stuck states in recorded trajectories, and which transitions lead out of them: what recovery learns from."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from fairlead.core.records import ActionOutcome, Trajectories, Transitions, ended_in
from fairlead.core.roles import ActionSampler, Dynamics, Environment, TransitionCheck

_SCREEN = 4
_ROWS = 1024


@dataclass(frozen=True)
class RecoveryExamples:
    """Transitions (s^t, a^t, s^{t+1}) whose start is stuck. share[n], the label, is what s^{t+1} is worth: the accepted
    part of actions there, or discounted what came later.

    source[n] is (trajectory, t) in the data; scene[n] its environment. `examined` transitions were looked at.
    """

    states: Float[np.ndarray, "example state"]
    actions: Float[np.ndarray, "example action"]
    share: Float[np.ndarray, " example"]
    scene: Int[np.ndarray, " example"]
    source: Int[np.ndarray, "example 2"]
    examined: int

    def __len__(self) -> int:
        return len(self.share)

    def counts(self) -> dict[str, Any]:
        """How many transitions were examined, in how many the start was stuck, and how the labels are distributed."""
        share = self.share
        labels = {
            "0": share == 0,
            "below 1/2": (share > 0) & (share < 0.5),
            "1/2 and above": (share >= 0.5) & (share < 1),
            "1": share == 1,
        }
        return {
            "examined": self.examined,
            "stuck": len(self),
            "labels": {name: int(rows.sum()) for name, rows in labels.items()},
            **({"mean_share": float(share.mean())} if len(self) else {}),
        }


def accepted(
    dynamics: Dynamics,
    check: TransitionCheck,
    sampler: ActionSampler,
    environment: Environment,
    states: Float[np.ndarray, "batch state"],
    count: int,
    rng: np.random.Generator,
) -> Bool[np.ndarray, "batch count"]:
    """Whether planning accepts what the dynamics predict for each of `count` random actions in each state: within
    bounds, and trusted."""
    if not len(states):
        return np.empty((0, count), bool)
    encodings = check.encode(environment, states)
    repeated, encoded = np.repeat(states, count, axis=0), np.repeat(encodings, count, axis=0)
    actions = sampler.propose(repeated, rng)
    found = np.empty(len(repeated), bool)
    for low in range(0, len(repeated), _ROWS):
        rows = slice(low, low + _ROWS)
        ahead = dynamics.predict(environment, repeated[rows], actions[rows])
        t = Transitions(repeated[rows], actions[rows], ahead.mean, ahead.spread)
        trust = check.probability(environment, t, encoded[rows], check.encode(environment, ahead.mean))
        found[rows] = environment.contains(ahead.mean) & (trust > 0.5)
    return found.reshape(len(states), count)


def recovery_examples(
    dynamics: Dynamics,
    check: TransitionCheck,
    sampler: ActionSampler,
    data: Trajectories,
    samples: int,
    limit: int,
    discount: float,
    rng: np.random.Generator,
    leave_out: Collection[ActionOutcome] = (),
) -> RecoveryExamples:
    """Find the stuck states of recorded trajectories: those where none of `samples` random actions is accepted.

    The label of a transition from a stuck state is the accepted part of `samples` actions at the next state (discount
    0, the paper's), or what a later state of the trajectory is worth, times `discount` for each further action, if that
    is more: out of a deep tangle no single action leads, but some are on the way. An action that stretched the
    object, and so was undone, has no part in what came later.

    Actions whose outcome is in `leave_out` are no examples. Whole trajectories are examined, a uniform sample of no
    more than `limit` transitions (one trajectory at least).
    """
    steps = data.actions.shape[1]
    chosen = np.sort(rng.permutation(len(data))[: max(1, limit // steps)])
    states, scenes = data.states[chosen], data.scene[chosen]
    share, is_stuck = np.full(states.shape[:2], np.nan), np.zeros(states.shape[:2], bool)
    for scene in np.unique(scenes):
        rows, environment = np.flatnonzero(scenes == scene), data.environments[scene]
        ask = partial(accepted, dynamics, check, sampler, environment, rng=rng)
        inside = states[rows]
        stuck = _stuck(inside.reshape(-1, inside.shape[-1]), samples, ask).reshape(inside.shape[:2])
        after = ~stuck & (np.cumsum(stuck, axis=1) > 0)
        found = np.where(stuck, 0.0, np.nan)
        found[after] = ask(inside[after], samples).mean(axis=1)
        share[rows], is_stuck[rows] = found, stuck
    value, outcomes = share.copy(), data.outcomes[chosen]
    for t in range(steps - 1, 0, -1):
        value[:, t] = np.fmax(value[:, t], discount * value[:, t + 1])
    undone = outcomes == ActionOutcome.STRETCH.number
    label = np.where(undone, share[:, 1:], value[:, 1:])
    left_out = ended_in(outcomes, leave_out)
    row, t = np.nonzero(is_stuck[:, :-1] & ~left_out)
    source = np.stack([chosen[row], t], axis=1)
    return RecoveryExamples(
        states[row, t], data.actions[chosen[row], t], label[row, t], scenes[row], source, len(chosen) * steps
    )


def _stuck(
    states: Float[np.ndarray, "batch state"], samples: int, ask: Callable[..., Bool[np.ndarray, "some count"]]
) -> Bool[np.ndarray, " batch"]:
    """Where none of `samples` actions is accepted. A few are tried at a time, only while a state may be stuck."""
    left = np.arange(len(states))
    for tried in range(0, samples, _SCREEN):
        if len(left):
            left = left[~ask(states[left], min(_SCREEN, samples - tried)).any(axis=1)]
    return np.isin(np.arange(len(states)), left)
