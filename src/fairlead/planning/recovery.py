"""Recovery policies that are not learned: none, at random, and by a plan that a weaker check accepts."""

from __future__ import annotations

from dataclasses import replace
from typing import final

import numpy as np
from jaxtyping import Float

from fairlead.core.budget import Budget, Meter
from fairlead.core.records import Plan
from fairlead.core.roles import ActionSampler, Environment, RecoveryPolicy
from fairlead.planning.problem import Planner, Problem


@final
class NoRecovery(RecoveryPolicy):
    """Always declines."""

    def choose(
        self, environment: Environment, states: Float[np.ndarray, "batch state"], rng: np.random.Generator
    ) -> Float[np.ndarray, "batch action"] | None:
        return None


@final
class RandomRecovery(RecoveryPolicy):
    """A random action of `sampler`: the paper's baseline for recovery."""

    def __init__(self, sampler: ActionSampler) -> None:
        self.sampler = sampler

    def choose(
        self, environment: Environment, states: Float[np.ndarray, "batch state"], rng: np.random.Generator
    ) -> Float[np.ndarray, "batch action"] | None:
        return self.sampler.propose(states, rng)


@final
class PlannedRecovery(RecoveryPolicy):
    """An action of a plan that a weaker check accepts; another policy's where there is no such plan.

    Not in the paper. Where nothing can be trusted, the way that at least avoids the obstacles is a better guess than
    chance. After each action the trusted check is asked again; where it still trusts nothing, and the rope is about
    where the plan has it, the plan is gone on with, unchecked: another each time would undo what the last has begun.
    Only single states are gone on from: each state of a batch has a plan of its own.

    Args:
        planner: does the planning.
        problem: with the weaker check; its environment gives way to the one that is asked about.
        otherwise: chooses where no plan makes a beginning.
        limit: most transitions that one plan checks, however little of a trial's budget is left.
        near: how far every gripper and point may be from its prediction [m] for the plan to be gone on with.
    """

    def __init__(
        self, planner: Planner, problem: Problem, otherwise: RecoveryPolicy, limit: int = 2000, near: float = 0.05
    ) -> None:
        self.planner, self.problem, self.otherwise, self.limit, self.near = planner, problem, otherwise, limit, near
        self._left: Plan | None = None

    def choose(
        self, environment: Environment, states: Float[np.ndarray, "batch state"], rng: np.random.Generator
    ) -> Float[np.ndarray, "batch action"] | None:
        if environment is not self.problem.environment:
            self.problem, self._left = replace(self.problem, environment=environment), None
        left, self._left = self._left if len(states) == 1 else None, None
        chosen: list[np.ndarray] = []
        for state in states:
            plan = left if left and self._goes_on(left, state) else self._new(state, rng)
            self._left = plan.rest() if len(states) == 1 else None
            action = plan.actions[:1] if len(plan) else self.otherwise.choose(environment, state[None], rng)
            if action is None:
                return None
            chosen.append(action)
        return np.concatenate(chosen)

    def forget(self) -> None:
        self._left = None
        self.otherwise.forget()

    def _new(self, state: Float[np.ndarray, " state"], rng: np.random.Generator) -> Plan:
        plan = self.planner.plan(self.problem, state, Meter(Budget(extensions=self.limit), lambda: 0.0), rng)
        self.extensions += plan.extensions
        return plan

    def _goes_on(self, plan: Plan, state: Float[np.ndarray, " state"]) -> bool:
        """Whether the state is about what the plan predicted, and its next action is none that was tried in vain."""
        off = np.linalg.norm((state - plan.states[0]).reshape(-1, 3), axis=1).max()
        return bool(off <= self.near and self.problem.sampler.allows(state[None], plan.actions[:1]).all())
