"""Where the tree is steered: ropes at random places, now and then in the goal."""

from __future__ import annotations

from typing import final

import numpy as np
from jaxtyping import Float

from fairlead.core.layout import StateLayout
from fairlead.planning.problem import Problem


@final
class Targets:
    """Draws states to steer to. A random target is a rope as long as the start's, with gentle random bends.

    Each link of the start keeps its height and its horizontal length; the headings run from one random heading with a
    constant random bend, at most a quarter turn over the rope; the middle lies anywhere within bounds.
    """

    def __init__(self, problem: Problem, start: Float[np.ndarray, " state"], goal_bias: float) -> None:
        self._layout, self._goal, self._bias = problem.layout, problem.goal, goal_bias
        self._low, self._high = problem.environment.bounds
        links = np.diff(_chain(problem.layout, start), axis=0)
        self._length, self._height = np.hypot(links[:, 0], links[:, 1]), links[:, 2]

    def sample(self, count: int, rng: np.random.Generator) -> Float[np.ndarray, "count state"]:
        """Random states, each with the probability of the goal bias moved into the goal."""
        states = self._ropes(count, rng)
        steered = rng.random(count) < self._bias
        if steered.any():
            states[steered] = self._goal.sample(states[steered], rng)
        return states

    def _ropes(self, count: int, rng: np.random.Generator) -> Float[np.ndarray, "count state"]:
        links = len(self._length)
        bend = rng.uniform(-np.pi / 2, np.pi / 2, (count, 1)) * np.linspace(-0.5, 0.5, links)
        heading = rng.uniform(-np.pi, np.pi, (count, 1)) + bend
        chain = np.zeros((count, links + 1, 3))
        chain[:, 1:, 0] = np.cumsum(self._length * np.cos(heading), axis=1)
        chain[:, 1:, 1] = np.cumsum(self._length * np.sin(heading), axis=1)
        chain[:, 1:, 2] = np.cumsum(self._height)
        chain += (rng.uniform(self._low, self._high, (count, 3)) - chain.mean(axis=1))[:, None]
        return _unchain(self._layout, chain)


def _chain(layout: StateLayout, state: Float[np.ndarray, " state"]) -> Float[np.ndarray, "link_and_one 3"]:
    """The points of a state in their order along the rope: left gripper (if there are two), rope, right gripper."""
    grippers, points = layout.grippers_of(state), layout.points_of(state)
    return np.concatenate([grippers[:-1], points, grippers[-1:]])


def _unchain(layout: StateLayout, chain: Float[np.ndarray, "count link_and_one 3"]) -> Float[np.ndarray, "count state"]:
    """The inverse of `_chain`."""
    first = len(layout.grippers) - 1
    grippers = np.concatenate([chain[:, :first], chain[:, -1:]], axis=1)
    return layout.join(grippers, chain[:, first:-1])
