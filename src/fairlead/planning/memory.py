"""Remembering, within a trial, which actions were cut short, and keeping away from them. Not in the paper."""

from __future__ import annotations

from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from fairlead.core.layout import StateLayout
from fairlead.core.roles import ActionSampler, Environment, RecoveryPolicy

TRIES = 16
"""How often an action is drawn anew, before one that was tried already is proposed after all."""


@final
class CutShort:
    """Where the grippers were when an action that was cut short began and ended, and which way it led.

    Args:
        layout: how to read a state.
        near: what was tried counts while every gripper is within this distance [m] of where it began, or of where it
            ended.
        cosine: of the angle, in the space of all grippers together, within which two actions lead the same way.
    """

    def __init__(self, layout: StateLayout, near: float = 0.05, cosine: float = 0.5) -> None:
        self._layout, self._near, self._cosine = layout, near, cosine
        self.forget()

    def forget(self) -> None:
        """Another trial begins."""
        self._where = np.empty((0, 2, len(self._layout.grippers), 3))
        self._way = np.empty((0, self._layout.action_size))

    def add(
        self,
        start: Float[np.ndarray, " state"],
        action: Float[np.ndarray, " action"],
        end: Float[np.ndarray, " state"],
    ) -> None:
        """An action was cut short: it led from one state to another."""
        where = self._layout.grippers_of(np.stack([start, end]))
        self._where = np.concatenate([self._where, where[None]])
        self._way = np.concatenate([self._way, _unit(action - where[:1].reshape(1, -1))])

    def covers(
        self, states: Float[np.ndarray, "batch state"], actions: Float[np.ndarray, "batch action"]
    ) -> Bool[np.ndarray, " batch"]:
        """Which actions lead where one was cut short, from about the same place."""
        grippers = self._layout.grippers_of(states)
        alike = _unit(actions - grippers.reshape(actions.shape)) @ self._way.T
        return np.any(self._near_to(states) & (alike > self._cosine), axis=1)

    def count(self, states: Float[np.ndarray, "batch state"]) -> Int[np.ndarray, " batch"]:
        """How many actions were cut short about where each state is."""
        return self._near_to(states).sum(axis=1)

    def _near_to(self, states: Float[np.ndarray, "batch state"]) -> Bool[np.ndarray, "batch tried"]:
        grippers = self._layout.grippers_of(states)
        away = np.linalg.norm(grippers[:, None, None] - self._where, axis=-1)
        return away.max(-1, initial=0.0).min(-1, initial=np.inf) < self._near


@final
class UntriedActions(ActionSampler):
    """Another sampler's actions, drawn anew where they lead as one did that was cut short.

    A repeated action is not drawn, and is not looked at: to forbid it would leave a method without recovery stuck.
    """

    def __init__(self, inner: ActionSampler, tried: CutShort) -> None:
        self.inner, self.tried = inner, tried

    def propose(
        self, states: Float[np.ndarray, "batch state"], rng: np.random.Generator
    ) -> Float[np.ndarray, "batch action"]:
        actions = self.inner.propose(states, rng)
        again = self.tried.covers(states, actions).nonzero()[0]
        for _ in range(TRIES):
            if not len(again):
                break
            actions[again] = self.inner.propose(states[again], rng)
            again = again[self.tried.covers(states[again], actions[again])]
        return actions

    def repeat(
        self,
        states: Float[np.ndarray, "batch state"],
        actions: Float[np.ndarray, "batch action"],
        next_states: Float[np.ndarray, "batch state"],
    ) -> Float[np.ndarray, "batch action"]:
        return self.inner.repeat(states, actions, next_states)

    def allows(
        self, states: Float[np.ndarray, "batch state"], actions: Float[np.ndarray, "batch action"]
    ) -> Bool[np.ndarray, " batch"]:
        return self.inner.allows(states, actions) & ~self.tried.covers(states, actions)


@final
class DoubtfulRecovery(RecoveryPolicy):
    """A policy's choice, or another's: each action that was cut short hereabouts halves the trust in the first."""

    def __init__(self, inner: RecoveryPolicy, otherwise: RecoveryPolicy, tried: CutShort) -> None:
        self.inner, self.otherwise, self.tried = inner, otherwise, tried

    def choose(
        self, environment: Environment, states: Float[np.ndarray, "batch state"], rng: np.random.Generator
    ) -> Float[np.ndarray, "batch action"] | None:
        chosen = self.inner.choose(environment, states, rng)
        doubted = np.flatnonzero(rng.random(len(states)) >= 0.5 ** self.tried.count(states))
        if chosen is not None and len(doubted):
            other = self.otherwise.choose(environment, states[doubted], rng)
            if other is not None:
                chosen[doubted] = other
        self.extensions = self.inner.extensions + self.otherwise.extensions
        return chosen

    def forget(self) -> None:
        self.inner.forget()
        self.otherwise.forget()


def _unit(ways: Float[np.ndarray, "n action"]) -> Float[np.ndarray, "n action"]:
    return ways / np.maximum(np.linalg.norm(ways, axis=-1, keepdims=True), 1e-9)
