"""A planner that plans again while what it has found takes long to execute. Not in the paper.

An RRT's plan is one of many: another tree may go round the other side of an obstacle. To plan once more takes a part of
a second, to execute a plan takes about one for each of its actions.
"""

from __future__ import annotations

from dataclasses import replace
from typing import final

import numpy as np
from jaxtyping import Float

from fairlead.core.budget import Meter
from fairlead.core.errors import FairleadError
from fairlead.core.records import Plan, PlanOutcome
from fairlead.planning.problem import Planner, Problem
from fairlead.planning.shorten import expected_length


@final
class Several(Planner):
    """Of several plans that reach the goal the one with the least `expected_length`.

    It plans again as long as it has checked fewer transitions than so many for each action of the best plan: a short
    plan is taken at once. Where the first attempt does not reach the goal there is no other. Each attempt has limits of
    its own, so the last may take longer than it can win.

    Args:
        planner: does the planning.
        extensions: transitions for each action of the best plan.
    """

    def __init__(self, planner: Planner, extensions: int = 500) -> None:
        if extensions < 1:
            raise FairleadError(f"extensions {extensions}: at least 1 is needed")
        self.planner, self.extensions = planner, extensions

    def plan(
        self, problem: Problem, start: Float[np.ndarray, " state"], meter: Meter, rng: np.random.Generator
    ) -> Plan:
        plans = [self.planner.plan(problem, start, meter, rng)]
        best = plans[0]
        while best.outcome is PlanOutcome.GOAL and not meter.exhausted:
            if sum(plan.extensions for plan in plans) >= self.extensions * len(best):
                break
            plans.append(self.planner.plan(problem, start, meter, rng))
            reached = [plan for plan in plans if plan.outcome is PlanOutcome.GOAL]
            best = min(reached, key=lambda plan: expected_length(plan, problem))
        return replace(
            best, extensions=sum(plan.extensions for plan in plans), invalid=sum(plan.invalid for plan in plans)
        )
