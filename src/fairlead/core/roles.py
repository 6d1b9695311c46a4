"""The roles. A method of the paper is a row of a table (dynamics x check x recovery), not a code path.

All take and return numpy arrays with a leading batch axis. Every class is abstract (here) or final (elsewhere), and
"nothing" is an object too: the accept-all check, the recovery that declines.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from fairlead.core.layout import StateLayout
from fairlead.core.records import Executed, Prediction, Transitions

LEAST_TRUST = 0.1
"""No planner accepts a transition whose probability is this or less."""
BOUNDS_MARGIN_M = 1e-3
"""A gripper that is sent to the bounds is predicted there to within this, as often outside as inside."""


class Environment(ABC):
    """The obstacles, seen as a field: E in the paper. Outside the map is free."""

    @property
    @abstractmethod
    def bounds(self) -> Float[np.ndarray, "2 3"]:
        """Lowest and highest corner [m] of the region where states may lie."""

    def contains(self, states: Float[np.ndarray, "batch state"]) -> Bool[np.ndarray, " batch"]:
        """Whether every point of a state lies within bounds, to a millimetre; false where it is NaN."""
        low, high = np.tile(self.bounds, states.shape[1] // 3)
        return ((states >= low - BOUNDS_MARGIN_M) & (states <= high + BOUNDS_MARGIN_M)).all(axis=1)

    @abstractmethod
    def signed_distance(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
        """Distance [m] from each point to the nearest obstacle surface, negative inside an obstacle."""

    @abstractmethod
    def distance_and_gradient(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 4"]:
        """Signed distance [m] and its gradient, exact or looked up on a grid computed once: for planning."""

    @abstractmethod
    def occupancy(self, resolution: float) -> tuple[Bool[np.ndarray, "nx ny nz"], Float[np.ndarray, " 3"]]:
        """Occupancy on a grid of that cell size [m], and the centre of its first cell; computed once, then kept."""

    @abstractmethod
    def occupied(self, points: Float[np.ndarray, "*batch 3"]) -> Bool[np.ndarray, "*batch"]:
        """Whether each point lies inside an obstacle."""


class World(ABC):
    """Something that can be observed and acted upon: a simulator, or a robot's driver. One row per copy."""

    @property
    @abstractmethod
    def layout(self) -> StateLayout:
        """How to read a state."""

    @abstractmethod
    def observe(self) -> Float[np.ndarray, "batch state"]:
        """The current, settled state of each copy [m]."""

    @abstractmethod
    def execute(self, actions: Float[np.ndarray, "batch action"]) -> Executed:
        """Carry out one action in each copy and wait until the object is at rest."""


class ActionSampler(ABC):
    """Proposes actions to try."""

    @abstractmethod
    def propose(
        self, states: Float[np.ndarray, "batch state"], rng: np.random.Generator
    ) -> Float[np.ndarray, "batch action"]:
        """One random action (target gripper positions [m]) for each state."""

    @abstractmethod
    def repeat(
        self,
        states: Float[np.ndarray, "batch state"],
        actions: Float[np.ndarray, "batch action"],
        next_states: Float[np.ndarray, "batch state"],
    ) -> Float[np.ndarray, "batch action"]:
        """The action that repeats, from `next_states`, the displacement that `actions` asked for in `states`."""

    def allows(
        self, states: Float[np.ndarray, "batch state"], actions: Float[np.ndarray, "batch action"]
    ) -> Bool[np.ndarray, " batch"]:
        """Which actions may be chosen by others than this sampler, too; by default all."""
        return np.ones(len(states), bool)


class Dynamics(ABC):
    """A model h(E, s, a) of what an action does."""

    @property
    @abstractmethod
    def layout(self) -> StateLayout:
        """How to read a state."""

    @abstractmethod
    def predict(
        self,
        environment: Environment,
        states: Float[np.ndarray, "batch state"],
        actions: Float[np.ndarray, "batch action"],
    ) -> Prediction:
        """The next state of each row and the spread of the ensemble about it [m]."""

    def predict_each(
        self,
        environments: Sequence[Environment],
        scene: Int[np.ndarray, " batch"],
        states: Float[np.ndarray, "batch state"],
        actions: Float[np.ndarray, "batch action"],
    ) -> Prediction:
        """`predict` of every row n in environments[scene[n]]; here one environment after the other."""
        mean, spread = np.empty(states.shape, np.float32), np.empty(len(states), np.float32)
        for index in np.unique(scene):
            rows = np.flatnonzero(scene == index)
            found = self.predict(environments[int(index)], states[rows], actions[rows])
            mean[rows], spread[rows] = found.mean, found.spread
        return Prediction(mean, spread)


class TransitionCheck(ABC):
    """The probability that a predicted transition is reliable: g(E, s^t, a^t, s^{t+1}, spread) in the paper."""

    @abstractmethod
    def encode(
        self, environment: Environment, states: Float[np.ndarray, "batch state"]
    ) -> Float[np.ndarray, "batch feature"]:
        """What the check needs of a state alone (float32). A planner keeps it with the node and never asks again."""

    @abstractmethod
    def probability(
        self,
        environment: Environment,
        transitions: Transitions,
        encodings: Float[np.ndarray, "batch feature"],
        next_encodings: Float[np.ndarray, "batch feature"],
    ) -> Float[np.ndarray, " batch"]:
        """Probability in [0, 1] that each transition is reliable; accepted above 0.5.

        NaN counts as rejected. At `LEAST_TRUST` and below it need not be exact.
        """


class RecoveryPolicy(ABC):
    """Chooses what to do where no prediction can be trusted.

    `extensions`: transitions that its choices have checked so far, which count as those of planning do.
    """

    extensions: int = 0

    @abstractmethod
    def choose(
        self,
        environment: Environment,
        states: Float[np.ndarray, "batch state"],
        rng: np.random.Generator,
    ) -> Float[np.ndarray, "batch action"] | None:
        """An action for each state, or None: this policy declines."""

    def forget(self) -> None:  # noqa: B027  most policies keep nothing
        """Another trial begins: what was chosen before no longer matters."""


class Goal(ABC):
    """What a trial is for: a state is in the goal where its error is within the tolerance."""

    @property
    @abstractmethod
    def tolerance(self) -> float:
        """Largest error of a state in the goal [m]."""

    @abstractmethod
    def error(self, states: Float[np.ndarray, "*batch state"]) -> Float[np.ndarray, "*batch"]:
        """Task error [m]: how far the state is from where it must be."""

    @final
    def reached(self, states: Float[np.ndarray, "*batch state"]) -> Bool[np.ndarray, "*batch"]:
        """Whether the error is within the tolerance; false where it is NaN."""
        return np.asarray(self.error(states) <= self.tolerance)

    @abstractmethod
    def sample(
        self, states: Float[np.ndarray, "batch state"], rng: np.random.Generator
    ) -> Float[np.ndarray, "batch state"]:
        """Turn sampled states into states of the goal, one each, or at least into none that are farther from it.

        This is what the goal bias steers the tree to.
        """
