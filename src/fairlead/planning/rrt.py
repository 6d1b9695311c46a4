"""The batched kinodynamic RRT (LaValle and Kuffner, 2001), the paper's planner: many extensions at a time.

Paper, "Planning": sample a control, apply it for several steps, stop at the first transition that the check rejects.
"""

from __future__ import annotations

from typing import final

import numpy as np
from jaxtyping import Float, Int

from fairlead.core.budget import Meter
from fairlead.core.errors import FairleadError
from fairlead.core.records import Plan, PlanOutcome
from fairlead.planning.problem import PAPER, Allowance, Planner, Problem, SearchSettings
from fairlead.planning.targets import Targets
from fairlead.planning.tree import Tree


@final
class BatchedRRT(Planner):
    """Runs `lanes` extensions side by side, so that every iteration is one batched prediction and one batched check.

    A lane whose extension ends, because a step was rejected or its control has been repeated often enough, at once
    draws a new target, the nearest node and a new control.

    Args:
        settings: what it shares with every planner.
        lanes: transitions in a batch.
        candidates: nearest nodes are looked for among at most this many random nodes.
    """

    def __init__(self, settings: SearchSettings = PAPER, lanes: int = 128, candidates: int = 1024) -> None:
        if min(lanes, candidates) < 1:
            raise FairleadError("lanes and candidates must be positive")
        self.settings, self.lanes, self.candidates = settings, lanes, candidates

    def plan(
        self, problem: Problem, start: Float[np.ndarray, " state"], meter: Meter, rng: np.random.Generator
    ) -> Plan:
        settings, allowance, before = self.settings, Allowance(self.settings, meter), meter.extensions
        tree = Tree(problem, start, self.candidates)
        lanes = _Lanes(problem, tree, Targets(problem, start, settings.goal_bias), settings.repeats, self.lanes, rng)
        outcome = PlanOutcome.GOAL if tree.goal_reached else None
        while outcome is None:
            tried = meter.extensions - before
            untried = settings.stuck_attempts - tried if len(tree) == 1 else self.lanes
            count = min(self.lanes, allowance.left, untried)
            if count > 0:
                lanes.extend(count)
                allowance.charge(count)
                outcome = PlanOutcome.GOAL if tree.goal_reached else None
            else:
                outcome = PlanOutcome.PARTIAL if untried > 0 else PlanOutcome.STUCK
        return tree.plan(outcome, meter.extensions - before, lanes.invalid)


@final
class _Lanes:
    """The extensions under way: the node each has reached, its next action, and how many steps it has left."""

    def __init__(
        self, problem: Problem, tree: Tree, targets: Targets, repeats: int, lanes: int, rng: np.random.Generator
    ) -> None:
        self._problem, self._tree, self._targets, self._repeats, self._rng = problem, tree, targets, repeats, rng
        self._nodes = np.zeros(lanes, np.int64)
        self._actions = np.zeros((lanes, problem.layout.action_size))
        self._left = np.zeros(lanes, np.int64)
        self.invalid = 0

    def extend(self, count: int) -> None:
        """Take one step in each of the first `count` lanes."""
        problem, tree = self._problem, self._tree
        self._draw(np.flatnonzero(self._left[:count] == 0))
        nodes, actions = self._nodes[:count], self._actions[:count]
        states = tree.states[nodes]
        tried = problem.attempt(states, actions, tree.encodings[nodes])
        self.invalid += tried.invalid
        kept = tried.accepted
        reached = tree.add(nodes, actions, tried, kept)
        repeated = problem.sampler.repeat(states[kept], actions[kept], tree.states[reached])
        self._left[:count] = np.where(kept, self._left[:count] - 1, 0)
        nodes[kept] = reached
        actions[kept] = repeated

    def _draw(self, ended: Int[np.ndarray, " ended"]) -> None:
        if not len(ended):
            return
        targets = self._targets.sample(len(ended), self._rng)
        nodes = self._tree.nearest(targets, self._rng)
        self._nodes[ended] = nodes
        self._actions[ended] = self._problem.sampler.propose(self._tree.states[nodes], self._rng)
        self._left[ended] = self._rng.integers(1, self._repeats, len(ended), endpoint=True)
