"""Recovery policies that are not learned: none, at random, and by a plan that a weaker check accepts."""

from __future__ import annotations

from dataclasses import replace
from typing import final

import numpy as np
from jaxtyping import Float

from fairlead.core.budget import Budget, Meter
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
    """The first action of a plan that a weaker check accepts; another policy's where there is none.

    Not in the paper. Where nothing can be trusted, the way that at least avoids the obstacles is a better guess than
    chance; after one action of it the trusted check is asked again.

    Args:
        planner: does the planning.
        problem: with the weaker check; its environment gives way to the one that is asked about.
        otherwise: chooses where no plan makes a beginning.
        limit: most transitions that one choice checks.
    """

    def __init__(self, planner: Planner, problem: Problem, otherwise: RecoveryPolicy, limit: int = 2000) -> None:
        self.planner, self.problem, self.otherwise, self.limit = planner, problem, otherwise, limit

    def choose(
        self, environment: Environment, states: Float[np.ndarray, "batch state"], rng: np.random.Generator
    ) -> Float[np.ndarray, "batch action"] | None:
        problem = replace(self.problem, environment=environment)
        chosen: list[np.ndarray] = []
        for state in states:
            plan = self.planner.plan(problem, state, Meter(Budget(extensions=self.limit), lambda: 0.0), rng)
            self.extensions += plan.extensions
            action = plan.actions[:1] if len(plan) else self.otherwise.choose(environment, state[None], rng)
            if action is None:
                return None
            chosen.append(action)
        return np.concatenate(chosen)
