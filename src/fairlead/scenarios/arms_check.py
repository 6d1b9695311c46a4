"""The arms are known: a check and a recovery that ask only for what they can do."""

from __future__ import annotations

from typing import final

import numpy as np
from jaxtyping import Bool, Float

from fairlead.core.answers import expect
from fairlead.core.errors import FairleadError
from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome, Transitions
from fairlead.core.roles import LEAST_TRUST, Environment, RecoveryPolicy, TransitionCheck
from fairlead.geometry.fields import BoxEnvironment
from fairlead.scenarios.arms import Arms
from fairlead.scenarios.scenario import Scenario


def within_reach(check: TransitionCheck, scenario: Scenario) -> TransitionCheck:
    """The check and what the scenario's arms can do; the check alone where there are no arms."""
    return check if scenario.arms is None else ArmsCheck(check, scenario.layout, scenario.arms)


def recovery_within_reach(policy: RecoveryPolicy, scenario: Scenario) -> RecoveryPolicy:
    """The policy, asked for what the scenario's arms can carry out; the policy alone where there are no arms."""
    return policy if scenario.arms is None else ArmsRecovery(policy, scenario.layout, scenario.arms)


@final
class ArmsCheck(TransitionCheck):
    """Another check's probability, and 0 where the arms are stopped before the targets of the action.

    The arms grasp the grippers of the state from their home posture, so a node of the tree carries no posture. Only
    what the other check trusts at least a little (`LEAST_TRUST`) is looked at: no planner accepts the rest.

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
        chance = np.array(self.inner.probability(environment, transitions, encodings, next_encodings))
        expect(self.inner, "the probability", chance, (len(transitions),))
        accepted = np.nonzero(chance > LEAST_TRUST)[0]
        states, actions = transitions.states[accepted], transitions.actions[accepted]
        chance[accepted[_stopped(self.arms, self.layout, environment, states, actions)]] = 0.0
        return chance


@final
class ArmsRecovery(RecoveryPolicy):
    """Another policy's choice; it is asked again, a few times, where the arms are stopped before the targets.

    Args:
        inner: the other policy.
        layout: how to read a state.
        arms: one for each gripper.
        tries: how often it is asked at most.
    """

    def __init__(self, inner: RecoveryPolicy, layout: StateLayout, arms: Arms, tries: int = 8) -> None:
        self.inner, self.layout, self.arms, self.tries = inner, layout, arms, tries

    def choose(
        self, environment: Environment, states: Float[np.ndarray, "batch state"], rng: np.random.Generator
    ) -> Float[np.ndarray, "batch action"] | None:
        actions, open_rows = None, np.arange(len(states))
        for _ in range(self.tries):
            chosen = self.inner.choose(environment, states[open_rows], rng)
            self.extensions = self.inner.extensions
            if chosen is None:
                return None
            actions = chosen if actions is None else actions
            actions[open_rows] = chosen
            open_rows = open_rows[_stopped(self.arms, self.layout, environment, states[open_rows], chosen)]
            if not len(open_rows):
                break
        return actions

    def forget(self) -> None:
        self.inner.forget()


def _stopped(
    arms: Arms,
    layout: StateLayout,
    environment: Environment,
    states: Float[np.ndarray, "batch state"],
    actions: Float[np.ndarray, "batch action"],
) -> Bool[np.ndarray, " batch"]:
    """Which actions the arms do not carry out to the end, grasping anew in each state."""
    if not isinstance(environment, BoxEnvironment):
        raise FairleadError("what the arms can do is known in an environment made of boxes only")
    grippers = layout.grippers_of(states)
    joints, _ = arms.grasp(grippers)
    path = arms.follow(joints, grippers, layout.grippers_of(actions), [environment.boxes] * len(states))
    return np.asarray(path.outcomes != ActionOutcome.TARGET.number)
