"""A planner that asks for less trust where no plan with enough of it reaches the goal. Not in the paper.

A plan that ends far from the goal is executed too, and takes much longer to execute than another took to be found.
"""

from __future__ import annotations

from dataclasses import replace
from typing import final

import numpy as np
from jaxtyping import Float

from fairlead.core.budget import Meter
from fairlead.core.errors import FairleadError
from fairlead.core.records import Plan, PlanOutcome
from fairlead.core.roles import LEAST_TRUST
from fairlead.planning.problem import Planner, Problem


@final
class Relaxed(Planner):
    """Plans again, each time with a lower threshold of trust, as long as plans end outside the goal.

    Where none ends in it, the first plan, the most trusted, is returned; where the start is stuck, nothing is relaxed:
    that is for recovery. Each attempt has limits of its own.

    Args:
        planner: does the planning.
        thresholds: of trust, after the problem's own, one after the other.
    """

    def __init__(self, planner: Planner, thresholds: tuple[float, ...] = (0.25, LEAST_TRUST)) -> None:
        if not all(LEAST_TRUST <= threshold < 1 for threshold in thresholds):
            raise FairleadError(f"thresholds {thresholds}: probabilities of at least {LEAST_TRUST} are needed")
        self.planner, self.thresholds = planner, thresholds

    def plan(
        self, problem: Problem, start: Float[np.ndarray, " state"], meter: Meter, rng: np.random.Generator
    ) -> Plan:
        plans = [self.planner.plan(problem, start, meter, rng)]
        for threshold in self.thresholds:
            if plans[-1].outcome is not PlanOutcome.PARTIAL or meter.exhausted:
                break
            plans.append(self.planner.plan(replace(problem, threshold=threshold), start, meter, rng))
        best = next((plan for plan in plans if plan.outcome is PlanOutcome.GOAL), plans[0])
        return replace(best, extensions=sum(p.extensions for p in plans), invalid=sum(p.invalid for p in plans))
