"""A planner that shortens what another finds: an RRT's plan wanders, and each of its actions adds time and drift.

Not in the paper. Stretches of a plan are replaced by straight ones, and everything after them is predicted and checked
anew: shortcutting (Geraerts and Overmars, 2007) for a model in which nothing but the grippers stays where it was.
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
    """How far the grippers move [m], over the chance that all of the plan is reliable.

    Where each failure costs another such plan, this is the way until one succeeds. The chance is the product of trust,
    as if transitions failed independently. Of several grippers the one that moves farthest counts.
    """
    return float(_moves(problem, plan.states[:-1], plan.actions).sum() / np.prod(plan.trust))


@final
class Shortened(Planner):
    """Plans, then tries straight stretches, `candidates` at once and `rounds` times, and keeps the best plan so far.

    The best is trusted throughout, ends in the goal and has the least `expected_length`. A plan that does not reach the
    goal is returned as it is. Both planning and shortening are within the limits of one attempt.

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
        if plan.outcome is not PlanOutcome.GOAL or len(plan) < 2:
            return plan
        starts = np.repeat(start[None], PROPOSALS, axis=0)
        reach = float(_moves(problem, starts, problem.sampler.propose(starts, rng)).max())
        for _ in range(self.rounds):
            ways = _straightened(problem, plan, reach, self.candidates, rng)
            if not len(ways.begins) or allowance.left <= 0:
                break
            before = plan
            plan = _best(problem, plan, ways, _follow(problem, plan, ways, reach, allowance))
            if len(ways.begins) < self.candidates and plan.actions is before.actions:
                break
        return plan


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
    """Where the ways lead: `counts` transitions were checked, all of them are accepted where the goal is `reached`."""

    states: Float[np.ndarray, "way step_and_one state"]
    trust: Float[np.ndarray, "way step"]
    counts: Int[np.ndarray, " way"]
    reached: Bool[np.ndarray, " way"]
    invalid: int


def _straightened(problem: Problem, plan: Plan, reach: float, limit: int, rng: np.random.Generator) -> _Ways:
    """The plan with a straight way between two of its states, in steps of equal length up to `reach`.

    Each with another pair of states, none of them one action apart; `limit` random ones where there are more.
    """
    grippers = problem.layout.grippers_of(plan.states)
    begins, ends = np.triu_indices(len(plan) + 1, k=2)
    chosen = rng.permutation(len(begins))[:limit]
    found: list[np.ndarray] = []
    for begin, end in zip(begins[chosen], ends[chosen], strict=True):
        way = grippers[end] - grippers[begin]
        steps = max(1, int(np.ceil(np.linalg.norm(way, axis=-1).max() / reach - 1e-9)))
        straight = grippers[begin] + np.linspace(0, 1, steps + 1)[1:, None, None] * way
        found.append(np.concatenate([straight.reshape(steps, -1), plan.actions[end:]]))
    counts = np.array([len(actions) for actions in found], int)
    padded = np.zeros((len(found), counts.max(initial=0), problem.layout.action_size))
    for row, actions in zip(padded, found, strict=True):
        row[: len(actions)] = actions
    return _Ways(begins[chosen], counts, padded)


def _follow(problem: Problem, plan: Plan, ways: _Ways, reach: float, allowance: Allowance) -> _Followed:
    """Predict and check the ways side by side, each as long as it is accepted and not yet in the goal."""
    count, steps = ways.actions.shape[:2]
    states = np.repeat(plan.states[ways.begins][:, None], steps + 1, axis=1)
    trust, counts, invalid = np.ones((count, steps)), np.zeros(count, int), 0
    reached, going = np.zeros(count, bool), (ways.counts > 0).nonzero()[0]
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
        accepted = tried.accepted & allowed
        reached[going] = accepted & problem.goal.reached(tried.next_states)
        onward = accepted & ~reached[going] & (ways.counts[going] > step + 1)
        going, encodings = going[onward], tried.encodings[onward]
    return _Followed(states, trust, counts, reached, invalid)


def _best(problem: Problem, plan: Plan, ways: _Ways, followed: _Followed) -> Plan:
    """The plan, or the way with a less expected length that reaches the goal."""
    best, least = plan, expected_length(plan, problem)
    for way in followed.reached.nonzero()[0]:
        begin, count = ways.begins[way], followed.counts[way]
        found = replace(
            plan,
            states=np.concatenate([plan.states[:begin], followed.states[way, : count + 1]]),
            actions=np.concatenate([plan.actions[:begin], ways.actions[way, :count]]),
            trust=np.concatenate([plan.trust[:begin], followed.trust[way, :count]]),
        )
        if (length := expected_length(found, problem)) < least:
            best, least = found, length
    return replace(
        best, extensions=plan.extensions + int(followed.counts.sum()), invalid=plan.invalid + followed.invalid
    )
