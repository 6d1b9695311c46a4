"""Stuck states in recorded trajectories, and which transitions lead out of them: what recovery learns from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from fairlead.core.records import Trajectories, Transitions
from fairlead.core.roles import ActionSampler, Dynamics, Environment, TransitionCheck

_SCREEN = 4
_ROWS = 1024


@dataclass(frozen=True)
class RecoveryExamples:
    """Transitions (s^t, a^t, s^{t+1}) whose start is stuck. share[n] is the accepted part of actions at s^{t+1}.

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
    """Whether the check accepts what the dynamics predict for each of `count` random actions in each state."""
    encodings = check.encode(environment, states)
    repeated, encoded = np.repeat(states, count, axis=0), np.repeat(encodings, count, axis=0)
    actions = sampler.propose(repeated, rng)
    found = np.empty(len(repeated), bool)
    for low in range(0, len(repeated), _ROWS):
        rows = slice(low, low + _ROWS)
        ahead = dynamics.predict(environment, repeated[rows], actions[rows])
        t = Transitions(repeated[rows], actions[rows], ahead.mean, ahead.spread)
        found[rows] = check.probability(environment, t, encoded[rows], check.encode(environment, ahead.mean)) > 0.5
    return found.reshape(len(states), count)


def recovery_examples(
    dynamics: Dynamics,
    check: TransitionCheck,
    sampler: ActionSampler,
    data: Trajectories,
    samples: int,
    limit: int,
    rng: np.random.Generator,
) -> RecoveryExamples:
    """Find the stuck states of recorded trajectories: those where none of `samples` random actions is accepted.

    No more than `limit` transitions are examined, a uniform sample. A few actions are tried at a time, and only while a
    state may still be stuck: most are not.
    """
    trajectories, steps = data.actions.shape[:2]
    every = rng.permutation(trajectories * steps)[:limit]
    source = np.stack(np.divmod(np.sort(every), steps), axis=1)
    rows, shares = [np.empty(0, np.intp)], [np.empty(0)]
    scenes = data.scene[source[:, 0]]
    for scene in np.unique(scenes):
        environment = data.environments[scene]
        candidates = np.flatnonzero(scenes == scene)
        for tried in range(0, samples, _SCREEN):
            states = data.states[tuple(source[candidates].T)]
            count = min(_SCREEN, samples - tried)
            free = accepted(dynamics, check, sampler, environment, states, count, rng).any(axis=1)
            candidates = candidates[~free]
            if not len(candidates):
                break
        else:
            after = data.states[source[candidates, 0], source[candidates, 1] + 1]
            rows.append(candidates)
            shares.append(accepted(dynamics, check, sampler, environment, after, samples, rng).mean(axis=1))
    stuck = source[np.concatenate(rows)]
    where = tuple(stuck.T)
    return RecoveryExamples(
        data.states[where], data.actions[where], np.concatenate(shares), data.scene[stuck[:, 0]], stuck, len(source)
    )
