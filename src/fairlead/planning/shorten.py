"""A planner that betters what another finds: an RRT's plan wanders and ends at the rim of the goal.

Not in the paper. Stretches of a plan are replaced by straight ones, its end is moved a little, and everything after a
change is predicted and checked anew: shortcutting (Geraerts and Overmars, 2007) for a model in which nothing but the
grippers stays where it was.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from fairlead.core.budget import Meter
from fairlead.core.errors import FairleadError
from fairlead.core.records import Plan, PlanOutcome
from fairlead.planning.problem import PAPER, Allowance, Planner, Problem, SearchSettings

PROPOSALS = 256
"""Actions asked of the sampler: no action of a straight stretch is longer than the longest of them."""
SLACK = 0.01
"""Grippers may be predicted so far from where they were sent [m], which makes the next action longer."""


def expected_length(plan: Plan, problem: Problem) -> float:
    """How far the grippers move [m], over the chance that the plan succeeds.

    Where each failure costs another such plan, this is the way until one succeeds. The chance is the product of trust,
    as if transitions failed independently, and that a plan which is executed as predicted, more or less, ends in the
    goal: 1 from its middle, a half from its rim. Of several grippers the one that moves farthest counts.
    """
    error, tolerance = float(problem.goal.error(plan.states[-1])), problem.goal.tolerance
    chance = np.prod(plan.trust, dtype=float) * (1 - min(error / tolerance, 1) / 2 if tolerance > 0 else 1)
    return float(_moves(problem, plan.states[:-1], plan.actions).sum() / chance)


@final
class Shortened(Planner):
    """Plans, then tries changes of the plan, `candidates` at once and `rounds` times, and keeps the best plan so far.

    The best is trusted throughout, ends in the goal and has the least `expected_length`; as long as none ends in the
    goal, it is the one that ends nearest. Both planning and shortening are within the limits of one attempt.

    Args:
        planner: does the planning.
        settings: the limits of an attempt.
        rounds: how often.
        candidates: plans that are predicted and checked side by side.
    """

    def __init__(
        self, planner: Planner, settings: SearchSettings = PAPER, rounds: int = 4, candidates: int = 32
    ) -> None:
        if min(rounds, candidates) < 1:
            raise FairleadError("rounds and candidates must be positive")
        self.planner, self.settings, self.rounds, self.candidates = planner, settings, rounds, candidates

    def plan(
        self, problem: Problem, start: Float[np.ndarray, " state"], meter: Meter, rng: np.random.Generator
    ) -> Plan:
        allowance = Allowance(self.settings, meter)
        plan = self.planner.plan(problem, start, meter, rng)
        if not len(plan):
            return plan
        starts = np.repeat(start[None], PROPOSALS, axis=0)
        reach = float(_moves(problem, starts, problem.sampler.propose(starts, rng)).max())
        for _ in range(self.rounds):
            if allowance.left <= 0:
                break
            ways = _changed(problem, plan, reach, self.candidates, rng)
            plan = _best(problem, plan, ways, _follow(problem, plan, ways, reach, allowance))
        return replace(plan, outcome=PlanOutcome.GOAL) if problem.goal.reached(plan.states[-1]) else plan


def _moves(
    problem: Problem, states: Float[np.ndarray, "step state"], actions: Float[np.ndarray, "step action"]
) -> Float[np.ndarray, " step"]:
    """How far each action moves the gripper that moves farthest [m]."""
    grippers = problem.layout.grippers_of
    return np.asarray(np.linalg.norm(grippers(actions) - grippers(states), axis=-1).max(axis=-1))


@dataclass(frozen=True)
class _Ways:
    """Candidates: each follows the plan up to state `begins`, then takes the first `counts` of its actions."""

    begins: Int[np.ndarray, " way"]
    counts: Int[np.ndarray, " way"]
    actions: Float[np.ndarray, "way step action"]


@dataclass(frozen=True)
class _Followed:
    """Where the ways lead: `counts` transitions were checked; up to an `accepted` one all are."""

    states: Float[np.ndarray, "way step_and_one state"]
    trust: Float[np.ndarray, "way step"]
    counts: Int[np.ndarray, " way"]
    accepted: Bool[np.ndarray, "way step"]
    invalid: int


def _changed(problem: Problem, plan: Plan, reach: float, count: int, rng: np.random.Generator) -> _Ways:
    """So many times the plan with a straight way between two of its states, in steps of equal length up to `reach`.

    As many pairs of states as there are; in at least half of the ways the last action is moved besides, at random,
    by no more than the goal's tolerance.
    """
    grippers = problem.layout.grippers_of(plan.states)
    begins, ends = np.triu_indices(len(plan) + 1, k=1)
    pairs = np.resize(rng.permutation(len(begins)), count)
    last = np.repeat(plan.states[-1:], count, axis=0)
    moved = problem.sampler.propose(last, rng) - last[:, : problem.layout.action_size]
    moved *= min(1.0, problem.goal.tolerance / reach)
    moved[: min(count // 2, len(begins))] = 0
    found: list[np.ndarray] = []
    for begin, end, move in zip(begins[pairs], ends[pairs], moved, strict=True):
        way = grippers[end] - grippers[begin]
        steps = max(1, int(np.ceil(np.linalg.norm(way, axis=-1).max() / reach - 1e-9)))
        straight = grippers[begin] + np.linspace(0, 1, steps + 1)[1:, None, None] * way
        found.append(np.concatenate([straight.reshape(steps, -1), plan.actions[end:]]))
        found[-1][-1] += move
    counts = np.array([len(actions) for actions in found])
    padded = np.zeros((count, counts.max(), problem.layout.action_size))
    for row, actions in zip(padded, found, strict=True):
        row[: len(actions)] = actions
    return _Ways(begins[pairs], counts, padded)


def _follow(problem: Problem, plan: Plan, ways: _Ways, reach: float, allowance: Allowance) -> _Followed:
    """Predict and check the ways side by side, each as long as it is accepted."""
    count, steps = ways.actions.shape[:2]
    states = np.repeat(plan.states[ways.begins][:, None], steps + 1, axis=1)
    trust, counts, invalid = np.ones((count, steps)), np.zeros(count, int), 0
    accepted, going = np.zeros((count, steps), bool), np.flatnonzero(ways.counts)
    encodings = problem.check.encode(problem.environment, states[:, 0])
    for step in range(steps):
        left = max(allowance.left, 0)
        going, encodings = going[:left], encodings[:left]
        if not len(going):
            break
        before, actions = states[going, step], ways.actions[going, step]
        tried = problem.attempt(before, actions, encodings)
        allowance.charge(len(going))
        counts[going] += 1
        invalid += tried.invalid
        states[going, step + 1], trust[going, step] = tried.next_states, tried.trust
        allowed = problem.sampler.allows(before, actions) & (_moves(problem, before, actions) <= reach + SLACK)
        accepted[going, step] = tried.accepted & allowed
        onward = accepted[going, step] & (ways.counts[going] > step + 1)
        going, encodings = going[onward], tried.encodings[onward]
    return _Followed(states, trust, counts, accepted, invalid)


def _best(problem: Problem, plan: Plan, ways: _Ways, followed: _Followed) -> Plan:
    """The best of the plan and of all beginnings of the ways."""

    def cost(of: Plan) -> tuple[float, float]:
        end = of.states[-1]
        return 0.0 if problem.goal.reached(end) else float(problem.goal.error(end)), expected_length(of, problem)

    best, least = plan, cost(plan)
    near = problem.goal.error(followed.states[:, 1:]) <= max(least[0], problem.goal.tolerance)
    for way, step in zip(*(followed.accepted & near).nonzero(), strict=True):
        begin, count = ways.begins[way], step + 1
        found = replace(
            plan,
            states=np.concatenate([plan.states[:begin], followed.states[way, : count + 1]]),
            actions=np.concatenate([plan.actions[:begin], ways.actions[way, :count]]),
            trust=np.concatenate([plan.trust[:begin], followed.trust[way, :count]]),
        )
        if (length := cost(found)) < least:
            best, least = found, length
    return replace(
        best, extensions=plan.extensions + int(followed.counts.sum()), invalid=plan.invalid + followed.invalid
    )
