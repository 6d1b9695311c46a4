"""A world that needs no simulator: a function says what actions do."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

import numpy as np
from jaxtyping import Float, Int

from fairlead.core.errors import FairleadError
from fairlead.core.layout import StateLayout
from fairlead.core.records import Executed
from fairlead.scenarios.simulate import SimulatedWorld

Act = Callable[[Int[np.ndarray, " some"], Float[np.ndarray, "some state"], Float[np.ndarray, "some action"]], Executed]
"""What happens in some copies, named by their numbers, when they carry out an action from a state each."""


@final
class ComputedWorld(SimulatedWorld):
    """Copies that are at rest as soon as `act` has said where.

    Args:
        layout: how to read a state.
        states: where each copy begins.
        act: what actions do.
    """

    def __init__(self, layout: StateLayout, states: Float[np.ndarray, "batch state"], act: Act) -> None:
        self._layout, self._states, self._act = layout, np.array(states, float), act
        self._actions = np.zeros((len(states), layout.action_size))
        self._sent, self._restarted = np.zeros((2, len(states)), bool)
        self._steps = 0

    @property
    def layout(self) -> StateLayout:
        return self._layout

    @property
    def residual(self) -> Float[np.ndarray, " batch"]:
        return np.zeros(len(self._states))

    @property
    def steps(self) -> int:
        return self._steps

    def observe(self) -> Float[np.ndarray, "batch state"]:
        return self._states.copy()

    def send(self, ids: Int[np.ndarray, " some"], actions: Float[np.ndarray, "some action"]) -> None:
        self._actions[ids], self._sent[ids] = actions, True

    def restart(self, ids: Int[np.ndarray, " some"], states: Float[np.ndarray, "some state"]) -> None:
        self._states[ids], self._restarted[ids] = states, True

    def receive(self, wanted: int = 1) -> tuple[Int[np.ndarray, " some"], Executed]:
        ids = np.flatnonzero(self._restarted)
        if len(ids):
            self._restarted[ids] = False
            return ids, Executed(self._states[ids], np.zeros(len(ids)), np.zeros(len(ids), int))
        ids = np.flatnonzero(self._sent)
        if not len(ids):
            raise FairleadError("no copy of the world has an action to carry out: send some first")
        executed = self._act(ids, self._states[ids], self._actions[ids])
        self._states[ids], self._sent[ids] = executed.states, False
        self._steps += len(ids)
        return ids, executed
