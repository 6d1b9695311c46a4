"""A planner that aims for the middle of the goal. Not in the paper.

A plan is executed open loop, so it drifts: at the rim of the goal a little drift misses it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import final

import numpy as np
from jaxtyping import Float

from fairlead.core.budget import Meter
from fairlead.core.errors import FairleadError
from fairlead.core.records import Plan, PlanOutcome
from fairlead.core.roles import Goal
from fairlead.planning.problem import Planner, Problem


@final
class Middle(Goal):
    """The states of a goal whose error is within a share of its tolerance."""

    def __init__(self, goal: Goal, share: float) -> None:
        self.goal, self.share = goal, share

    @property
    def tolerance(self) -> float:
        return self.share * self.goal.tolerance

    def error(self, states: Float[np.ndarray, "*batch state"]) -> Float[np.ndarray, "*batch"]:
        return self.goal.error(states)

    def sample(
        self, states: Float[np.ndarray, "batch state"], rng: np.random.Generator
    ) -> Float[np.ndarray, "batch state"]:
        return self.goal.sample(states, rng)


@final
class ToTheMiddle(Planner):
    """Plans to the middle of the goal. Where time runs out first, the plan that ends nearest may still end in the goal.

    A goal without a tolerance (a box, several goals as one) has no middle: it is planned to as it is.

    Args:
        planner: does the planning.
        share: of the goal's tolerance.
    """

    def __init__(self, planner: Planner, share: float = 0.8) -> None:
        if not 0 < share <= 1:
            raise FairleadError(f"share {share}: more than 0 and at most 1 is needed")
        self.planner, self.share = planner, share

    def plan(
        self, problem: Problem, start: Float[np.ndarray, " state"], meter: Meter, rng: np.random.Generator
    ) -> Plan:
        plan = self.planner.plan(replace(problem, goal=Middle(problem.goal, self.share)), start, meter, rng)
        if plan.outcome is PlanOutcome.PARTIAL and problem.goal.reached(plan.states[-1]):
            return replace(plan, outcome=PlanOutcome.GOAL)
        return plan
