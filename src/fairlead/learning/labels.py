"""From trajectories among obstacles to labelled transitions: where was the model right? (paper, Fig. 3)

Two rules, and a count of each:

`figure`  as in Fig. 3 and as the authors ran it: a rollout restarts at every state of a trajectory and runs up to 20
          steps; each of its transitions whose start states are close, d(s_hat^t, s^t) < delta, is an example.
`text`    as the text says: one rollout from the start of each trajectory; what follows the first label 0 is dropped.

The label is d(s_hat^{t+1}, s^{t+1}) < delta in both. Actions that ended in certain ways may be left out: what an arm
cut short says nothing of the model, where the arms are known (docs/adr/0009).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from fairlead.core.errors import UnknownNameError
from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome, Trajectories, Transitions, ended_in
from fairlead.core.roles import Dynamics, Environment
from fairlead.geometry.distance import model_error
from fairlead.learning.rollout import roll_out

RULES = ("figure", "text")
FIGURE_STEPS = 20
_TRAJECTORIES = 64
CUT_BY_ARMS = (ActionOutcome.JOINT_LIMIT, ActionOutcome.ARM_COLLISION)


@dataclass(frozen=True)
class Examples:
    """Labelled predicted transitions, and where each comes from.

    labels[n] is True where the prediction was reliable; error is d(s_hat^{t+1}, s^{t+1}) [m]. before is what must be
    below delta for it to be an example [m]: d(s_hat^t, s^t) under the rule `figure`, the largest d so far under `text`.
    scene[n] indexes `environments`. source[n] is (trajectory, step at which its rollout started, step of its start
    state).
    """

    layout: StateLayout
    environments: Sequence[Environment]
    transitions: Transitions
    labels: Bool[np.ndarray, " example"]
    error: Float[np.ndarray, " example"]
    before: Float[np.ndarray, " example"]
    scene: Int[np.ndarray, " example"]
    source: Int[np.ndarray, "example 3"]

    def __len__(self) -> int:
        return len(self.labels)

    def take(self, rows: Int[np.ndarray, " row"]) -> Self:
        """Some of the examples."""
        t = self.transitions
        chosen = Transitions(t.states[rows], t.actions[rows], t.next_states[rows], t.spread[rows])
        columns = (self.labels, self.error, self.before, self.scene, self.source)
        return type(self)(self.layout, self.environments, chosen, *(column[rows] for column in columns))

    def at(self, delta: float) -> Self:
        """The examples as labelled at a smaller delta [m]: the same as to roll out and label anew."""
        kept = self.take(np.flatnonzero(self.before < delta))
        return replace(kept, labels=kept.error < delta)

    def sample(self, limit: int, rng: np.random.Generator) -> Self:
        """A uniform sample of `limit` examples in their order; all of them where there are no more."""
        if len(self) <= limit:
            return self
        return self.take(np.sort(rng.choice(len(self), limit, replace=False)))

    def counts(self) -> dict[str, Any]:
        """Number of examples and the share of label 1."""
        return {"examples": len(self), "reliable": float(self.labels.mean())}

    def by_scene(self) -> Iterator[tuple[Environment, Int[np.ndarray, " row"]]]:
        """Each environment with the rows of its examples."""
        for scene in np.unique(self.scene):
            yield self.environments[scene], np.flatnonzero(self.scene == scene)


def label(
    dynamics: Dynamics,
    data: Trajectories,
    delta: float,
    rule: str = "figure",
    leave_out: Collection[ActionOutcome] = (),
) -> Examples:
    """The examples of `data` under the mean predictions of `dynamics`.

    Actions whose outcome is in `leave_out` are no examples.

    Raises:
        UnknownNameError: a rule that is not in `RULES`.
    """
    if rule not in RULES:
        raise UnknownNameError("labelling rule", rule, RULES)
    wanted = ~ended_in(data.outcomes, leave_out)
    order, found_by = np.argsort(data.scene, kind="stable"), _figure if rule == "figure" else _text
    parts = [
        found_by(dynamics, data, wanted, rows, delta) for rows in np.array_split(order, -(-len(order) // _TRAJECTORIES))
    ]
    states, actions, next_states, spread, error, before, source = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    scenes = data.scene[source[:, 0]]
    transitions = Transitions(states, actions, next_states, spread)
    return Examples(data.layout, data.environments, transitions, error < delta, error, before, scenes, source)


_Found = tuple[Float32[np.ndarray, "example _"], ...]


def _figure(
    dynamics: Dynamics,
    data: Trajectories,
    wanted: Bool[np.ndarray, "trajectory steps"],
    rows: Int[np.ndarray, " row"],
    delta: float,
) -> _Found:
    """Rollouts from every state; each transition whose start states are close."""
    length = data.actions.shape[1]
    steps = min(FIGURE_STEPS, length)
    # Rollouts that would run past the end repeat the last action; those steps are not examples.
    begin = np.arange(length)
    at = np.minimum(begin[:, None] + np.arange(steps), length - 1)
    actions = data.actions[rows][:, at].reshape(-1, steps, data.actions.shape[2])
    starts, scene = data.states[rows][:, begin].reshape(len(actions), -1), np.repeat(data.scene[rows], length)
    predicted, spread = roll_out(dynamics, data.environments, scene, starts, actions)
    actual_at = np.minimum(begin[:, None] + np.arange(steps + 1), length)
    actual = data.states[rows][:, actual_at].reshape(predicted.shape)
    error = model_error(data.layout, predicted, actual).astype(np.float32)
    recorded = (begin[:, None] + np.arange(steps) < length) & wanted[rows][:, at]
    before = error[:, :-1]
    rollout, step = np.nonzero(recorded.reshape(-1, steps) & (before < delta))
    first = np.tile(begin, len(rows))[rollout]
    source = np.stack([rows[rollout // length], first, first + step], axis=1)
    return _gather(predicted, actions, spread, error, before, rollout, step, source)


def _text(
    dynamics: Dynamics,
    data: Trajectories,
    wanted: Bool[np.ndarray, "trajectory steps"],
    rows: Int[np.ndarray, " row"],
    delta: float,
) -> _Found:
    """One rollout from each start; everything up to and including the first label 0."""
    starts, actions = data.states[rows, 0], data.actions[rows]
    predicted, spread = roll_out(dynamics, data.environments, data.scene[rows], starts, actions)
    error = model_error(data.layout, predicted, data.states[rows]).astype(np.float32)
    before = np.maximum.accumulate(error[:, :-1], axis=1)
    rollout, step = np.nonzero((before < delta) & wanted[rows])
    source = np.stack([rows[rollout], np.zeros_like(step), step], axis=1)
    return _gather(predicted, actions, spread, error, before, rollout, step, source)


def _gather(
    predicted: Float32[np.ndarray, "rollout steps_and_one state"],
    actions: Float[np.ndarray, "rollout steps action"],
    spread: Float32[np.ndarray, "rollout steps"],
    error: Float32[np.ndarray, "rollout steps_and_one"],
    before: Float32[np.ndarray, "rollout steps"],
    rollout: Int[np.ndarray, " example"],
    step: Int[np.ndarray, " example"],
    source: Int[np.ndarray, "example 3"],
) -> _Found:
    return (
        predicted[rollout, step],
        actions[rollout, step].astype(np.float32),
        predicted[rollout, step + 1],
        spread[rollout, step],
        error[rollout, step + 1],
        before[rollout, step],
        source,
    )
