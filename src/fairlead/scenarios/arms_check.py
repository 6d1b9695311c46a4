"""The arms are known: a check that lets planning ask only for what they can do."""

from __future__ import annotations

from typing import final

import numpy as np
from jaxtyping import Float

from fairlead.core.errors import FairleadError
from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome, Transitions
from fairlead.core.roles import Environment, TransitionCheck
from fairlead.geometry.fields import BoxEnvironment
from fairlead.scenarios.arms import Arms
from fairlead.scenarios.scenario import Scenario

_TARGET = tuple(ActionOutcome).index(ActionOutcome.TARGET)


def within_reach(check: TransitionCheck, scenario: Scenario) -> TransitionCheck:
    """The check and what the scenario's arms can do; the check alone where there are no arms."""
    return check if scenario.arms is None else ArmsCheck(check, scenario.layout, scenario.arms)


@final
class ArmsCheck(TransitionCheck):
    """Another check's probability, and 0 where the arms are stopped before the targets of the action.

    The arms grasp the grippers of the state from their home posture, so a node of the tree carries no posture. Only
    what the other check accepts (above 0.5) is looked at: the rest is rejected already.

    Args:
        inner: the other check; its encodings are this one's.
        layout: how to read a state.
        arms: one for each gripper.
    """

    def __init__(self, inner: TransitionCheck, layout: StateLayout, arms: Arms) -> None:
        self.inner, self.layout, self.arms = inner, layout, arms

    def encode(
        self, environment: Environment, states: Float[np.ndarray, "batch state"]
    ) -> Float[np.ndarray, "batch feature"]:
        return self.inner.encode(environment, states)

    def probability(
        self,
        environment: Environment,
        transitions: Transitions,
        encodings: Float[np.ndarray, "batch feature"],
        next_encodings: Float[np.ndarray, "batch feature"],
    ) -> Float[np.ndarray, " batch"]:
        if not isinstance(environment, BoxEnvironment):
            raise FairleadError("the arms' check needs an environment made of boxes")
        chance = np.array(self.inner.probability(environment, transitions, encodings, next_encodings))
        accepted = np.nonzero(chance > 0.5)[0]
        grippers = self.layout.grippers_of(transitions.states[accepted])
        targets = self.layout.grippers_of(transitions.actions[accepted])
        joints, _ = self.arms.grasp(grippers)
        path = self.arms.follow(joints, grippers, targets, [environment.boxes] * len(accepted))
        chance[accepted[path.outcomes != _TARGET]] = 0.0
        return chance
