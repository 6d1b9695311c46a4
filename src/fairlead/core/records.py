"""The records that pass between the parts. Arrays have a leading batch axis unless said otherwise."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int

from fairlead.core.errors import UnknownNameError
from fairlead.core.layout import StateLayout

if TYPE_CHECKING:
    from fairlead.core.roles import Environment

Member = TypeVar("Member", bound="Explained")


class Explained(Enum):
    """An enumeration whose members carry a sentence for people, and their number in its order for arrays."""

    def __init__(self, label: str, sentence: str) -> None:
        self.label = label
        self.sentence = sentence
        self.number = len(type(self).__members__)

    @classmethod
    def of(cls: type[Member], label: str) -> Member:
        """The member with that label; UnknownNameError if there is none."""
        for member in cls:
            if member.label == label:
                return member
        raise UnknownNameError(cls.__name__.lower(), label, [member.label for member in cls])


class ActionOutcome(Explained):
    """How the execution of one action ended."""

    TARGET = ("target", "The gripper reached its target.")
    TIMEOUT = ("timeout", "The gripper was stopped before its target until the time for an action ran out.")
    JOINT_LIMIT = ("joint_limit", "An arm stopped at a joint limit.")
    ARM_COLLISION = ("arm_collision", "An arm stopped just before a collision.")
    STRETCH = ("stretch", "The motion was undone because it stretched the rope.")
    DIVERGED = ("diverged", "The simulation diverged; the transition is not data.")


def ended_in(outcomes: Int[np.ndarray, "*batch"], some: Collection[ActionOutcome]) -> Bool[np.ndarray, "*batch"]:
    """Which numbers of outcomes are those of some."""
    return np.isin(outcomes, [outcome.number for outcome in some])


class PlanOutcome(Explained):
    """How one planning attempt ended."""

    GOAL = ("goal", "The plan ends in the goal.")
    PARTIAL = ("partial", "Time ran out; the plan ends at the node nearest to the goal, which may be the start.")
    STUCK = ("stuck", "Nothing tried from the start was accepted: recovery is needed.")


class TrialOutcome(Explained):
    """How a trial ended."""

    GOAL = ("goal", "The observed state is in the goal.")
    BUDGET = ("budget", "The budget was spent before the goal was reached.")
    STUCK = ("stuck", "No action was trusted and no recovery led on (at the first such plan under protocol 'paper').")
    DIVERGED = ("diverged", "The simulation diverged during execution.")
    INTERRUPTED = ("interrupted", "A person stopped the trial.")


@dataclass(frozen=True)
class Prediction:
    """What the dynamics predict: the ensemble's mean and its `spread`.

    spread [m] is the sum over state dimensions of the standard deviation over the ensemble (the paper's sigma^2).
    """

    mean: Float[np.ndarray, "batch state"]
    spread: Float[np.ndarray, " batch"]


@dataclass(frozen=True)
class Transitions:
    """Predicted transitions (s^t, a^t, s^{t+1}) with the spread of their prediction; the input of a check."""

    states: Float[np.ndarray, "batch state"]
    actions: Float[np.ndarray, "batch action"]
    next_states: Float[np.ndarray, "batch state"]
    spread: Float[np.ndarray, " batch"]

    def __len__(self) -> int:
        return len(self.states)


@dataclass(frozen=True)
class Executed:
    """What a world did with a batch of actions: the settled next states, how long it took, how each ended.

    outcomes holds numbers of `ActionOutcome`. A diverged row keeps the state before its action.
    """

    states: Float[np.ndarray, "batch state"]
    seconds: Float[np.ndarray, " batch"]
    outcomes: Int[np.ndarray, " batch"]

    @property
    def diverged(self) -> Bool[np.ndarray, " batch"]:
        """Rows whose simulation diverged."""
        return self.outcomes == ActionOutcome.DIVERGED.number


@dataclass(frozen=True)
class SearchTree:
    """What a planner accepted: node 0 is the start, trust[i] that of the transition from node parents[i] to node i."""

    states: Float[np.ndarray, "node state"]
    parents: Int[np.ndarray, " node"]
    trust: Float[np.ndarray, " node"]


@dataclass(frozen=True)
class Plan:
    """One planning attempt: T actions from states[0] to states[T], and the trust in each transition.

    No batch axis. `extensions` counts the transitions that were checked, `invalid` those of them whose prediction or
    probability was not a finite number; `nodes` is the size of the tree, and `tree` the tree, for looking at: a plan
    that was shortened does not lie in it.
    """

    outcome: PlanOutcome
    states: Float[np.ndarray, "steps_and_one state"]
    actions: Float[np.ndarray, "steps action"]
    trust: Float[np.ndarray, " steps"]
    extensions: int
    nodes: int
    invalid: int = 0
    tree: SearchTree | None = None

    def __len__(self) -> int:
        return len(self.actions)

    def rest(self) -> Plan:
        """The plan without its first action; an empty plan is its own rest."""
        return replace(self, states=self.states[min(1, len(self)) :], actions=self.actions[1:], trust=self.trust[1:])


@dataclass(frozen=True)
class Trajectories:
    """Recorded trajectories of equal length T, each in one of `environments`: what learning reads.

    states[n, t] is s^t of trajectory n, actions[n, t] leads from s^t to s^{t+1}, outcomes[n, t] says how it ended
    (a number of `ActionOutcome`); scene[n] indexes `environments`.
    """

    layout: StateLayout
    states: Float[np.ndarray, "trajectory steps_and_one state"]
    actions: Float[np.ndarray, "trajectory steps action"]
    outcomes: Int[np.ndarray, "trajectory steps"]
    scene: Int[np.ndarray, " trajectory"]
    environments: Sequence[Environment]

    def __len__(self) -> int:
        return len(self.states)
