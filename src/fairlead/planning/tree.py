"""The search tree: arrays that grow by doubling, one row a node."""

from __future__ import annotations

from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from fairlead.core.records import Plan, PlanOutcome, SearchTree
from fairlead.planning.metric import Metric
from fairlead.planning.problem import Problem, Tried


@final
class Tree:
    """Nodes reached by accepted transitions, from the start at node 0.

    Each node keeps its state, the action and the trust of the transition that reached it, and what the check needs of
    its state (`encodings`), so that this is computed once. `best` is the node with the least goal error.

    Args:
        problem: gives the layout, the goal and the check.
        start: the state at node 0.
        candidates: nearest nodes are looked for among at most this many random nodes.
    """

    def __init__(self, problem: Problem, start: Float[np.ndarray, " state"], candidates: int = 1024) -> None:
        self._goal, self._metric, self._candidates = problem.goal, Metric(problem.layout), candidates
        root = np.asarray(start, float)[None]
        encoding = problem.check.encode(problem.environment, root)
        keys = root.astype(np.float32)
        self._columns: dict[str, np.ndarray] = {
            "states": root,
            "actions": np.zeros((1, problem.layout.action_size)),
            "parents": np.zeros(1, np.int64),
            "trust": np.ones(1, np.float32),
            "encodings": encoding,
            "keys": keys,
            "squares": self._metric.squares(keys),
        }
        self._size, self._capacity = 1, 1
        self.best, self.best_error = 0, float(self._goal.error(root)[0])

    def __len__(self) -> int:
        return self._size

    @property
    def states(self) -> Float[np.ndarray, "node state"]:
        """State of each node [m]."""
        return self._columns["states"][: self._size]

    @property
    def encodings(self) -> Float[np.ndarray, "node feature"]:
        """What the check needs of each state."""
        return self._columns["encodings"][: self._size]

    @property
    def goal_reached(self) -> bool:
        """Whether the best node is in the goal."""
        return self.best_error <= self._goal.tolerance

    def add(
        self,
        parents: Int[np.ndarray, " batch"],
        actions: Float[np.ndarray, "batch action"],
        tried: Tried,
        rows: Bool[np.ndarray, " batch"],
    ) -> Int[np.ndarray, " accepted"]:
        """Add the transitions marked in `rows`, each from its parent; returns the new nodes."""
        states = np.asarray(tried.next_states[rows], float)
        keys = states.astype(np.float32)
        first, last = self._size, self._size + len(states)
        self._reserve(last)
        new = {"states": states, "actions": actions[rows], "parents": parents[rows], "trust": tried.trust[rows],
               "encodings": tried.encodings[rows], "keys": keys, "squares": self._metric.squares(keys)}  # fmt: skip
        for name, values in new.items():
            self._columns[name][first:last] = values
        self._size = last
        if len(states):
            errors = self._goal.error(states)
            least = int(errors.argmin())
            if errors[least] < self.best_error:
                self.best, self.best_error = first + least, float(errors[least])
        return np.arange(first, last)

    def _reserve(self, size: int) -> None:
        if size <= self._capacity:
            return
        self._capacity = max(1024, 2 * size)
        for name, column in self._columns.items():
            grown = np.empty((self._capacity, *column.shape[1:]), column.dtype)
            grown[: self._size] = column[: self._size]
            self._columns[name] = grown

    def nearest(
        self, targets: Float[np.ndarray, "target state"], rng: np.random.Generator
    ) -> Int[np.ndarray, " target"]:
        """The node nearest to each target among a random sample of nodes and the best one.

        A sample keeps the cost of an extension the same in a small tree and in a large one.
        """
        keys, squares = self._columns["keys"], self._columns["squares"]
        if self._size <= self._candidates:
            return self._metric.nearest(targets.astype(np.float32), keys[: self._size], squares[: self._size])
        sample = rng.integers(self._size, size=self._candidates)
        sample[0] = self.best
        return sample[self._metric.nearest(targets.astype(np.float32), keys[sample], squares[sample])]

    def plan(self, outcome: PlanOutcome, extensions: int, invalid: int) -> Plan:
        """The plan that leads from the start to the best node."""
        parents, path = self._columns["parents"], [self.best]
        while path[-1]:
            path.append(int(parents[path[-1]]))
        nodes = np.array(path[::-1])
        trust = self._columns["trust"]
        return Plan(
            outcome,
            self.states[nodes],
            self._columns["actions"][nodes[1:]],
            trust[nodes[1:]],
            extensions,
            self._size,
            invalid,
            SearchTree(self.states, parents[: self._size], trust[: self._size]),
        )
