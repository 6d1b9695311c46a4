"""How fast planning checks transitions: against OMPL, against its own networks alone, and as the tree grows.

Each function measures what it compares in one run, in turns, and returns the median ratio with the rates behind it.
Rates are in checked transitions a second.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import final

import numpy as np
from jaxtyping import Bool, Float

from benchmarks.rates import Rates
from fairlead.core.budget import Budget, Meter
from fairlead.core.records import Plan, Transitions
from fairlead.core.roles import ActionSampler, Environment, Goal, TransitionCheck
from fairlead.core.streams import stream
from fairlead.planning.ompl import OmplRRT
from fairlead.planning.problem import Planner, Problem, SearchSettings
from fairlead.planning.rrt import BatchedRRT

ROUNDS = 5


@final
class Nowhere(Goal):
    """A goal's samples without the goal: the tree is steered as ever, and never arrives."""

    def __init__(self, goal: Goal) -> None:
        self._goal = goal

    @property
    def tolerance(self) -> float:
        return -1.0

    def error(self, states: Float[np.ndarray, "*batch state"]) -> Float[np.ndarray, "*batch"]:
        return self._goal.error(states)

    def sample(
        self, states: Float[np.ndarray, "batch state"], rng: np.random.Generator
    ) -> Float[np.ndarray, "batch state"]:
        return self._goal.sample(states, rng)


@final
class Obliging(TransitionCheck):
    """Does a check's work, then accepts: so that a tree grows whatever the check was trained on."""

    def __init__(self, check: TransitionCheck) -> None:
        self._check = check

    def encode(
        self, environment: Environment, states: Float[np.ndarray, "batch state"]
    ) -> Float[np.ndarray, "batch feature"]:
        return self._check.encode(environment, states)

    def probability(
        self,
        environment: Environment,
        transitions: Transitions,
        encodings: Float[np.ndarray, "batch feature"],
        next_encodings: Float[np.ndarray, "batch feature"],
    ) -> Float[np.ndarray, " batch"]:
        answer = self._check.probability(environment, transitions, encodings, next_encodings)
        return np.maximum(answer, 1.0)


@final
class Stopwatch(ActionSampler):
    """Notes the time and the number of nodes each time that a planner repeats the actions it accepted."""

    def __init__(self, sampler: ActionSampler) -> None:
        self._sampler = sampler
        self.seconds: list[float] = []
        self.nodes: list[int] = [1]

    def propose(
        self, states: Float[np.ndarray, "batch state"], rng: np.random.Generator
    ) -> Float[np.ndarray, "batch action"]:
        return self._sampler.propose(states, rng)

    def repeat(
        self,
        states: Float[np.ndarray, "batch state"],
        actions: Float[np.ndarray, "batch action"],
        next_states: Float[np.ndarray, "batch state"],
    ) -> Float[np.ndarray, "batch action"]:
        self.seconds.append(time.perf_counter())
        self.nodes.append(self.nodes[-1] + len(states))
        return self._sampler.repeat(states, actions, next_states)

    def allows(
        self, states: Float[np.ndarray, "batch state"], actions: Float[np.ndarray, "batch action"]
    ) -> Bool[np.ndarray, " batch"]:
        return self._sampler.allows(states, actions)


def growing(problem: Problem) -> Problem:
    """The problem with its networks at work, but a tree that always grows and never arrives."""
    return replace(problem, goal=Nowhere(problem.goal), check=Obliging(problem.check))


def timed_plan(
    planner: Planner, problem: Problem, start: Float[np.ndarray, " state"], extensions: int, seed: int
) -> tuple[float, Plan]:
    """The rate of one attempt that checks so many transitions, and its plan."""
    meter = Meter(Budget(extensions=extensions), time.perf_counter)
    begun = time.perf_counter()
    plan = planner.plan(problem, start, meter, stream(seed, "benchmark"))
    return plan.extensions / (time.perf_counter() - begun), plan


def networks_alone(problem: Problem, plan: Plan, lanes: int, extensions: int) -> float:
    """The rate of prediction, encoding and check on batches of tree nodes, with nothing else."""
    assert plan.tree is not None
    rng = stream(0, "batches")
    states = plan.tree.states[rng.integers(len(plan.tree.states), size=lanes)]
    actions = problem.sampler.propose(states, rng)
    encodings = problem.check.encode(problem.environment, states)
    batches = max(1, extensions // lanes)
    begun = time.perf_counter()
    for _ in range(batches):
        prediction = problem.dynamics.predict(problem.environment, states, actions)
        following = problem.check.encode(problem.environment, prediction.mean)
        transitions = Transitions(states, actions, prediction.mean, prediction.spread)
        problem.check.probability(problem.environment, transitions, encodings, following)
    return batches * lanes / (time.perf_counter() - begun)


def planner_vs_ompl(
    problem: Problem, start: Float[np.ndarray, " state"], extensions: int = 10_000, ompl_extensions: int = 500
) -> Rates:
    """Checked transitions a second of our planner over those of OMPL's, with the same networks."""
    problem = growing(problem)
    timed_plan(BatchedRRT(), problem, start, 1000, 0)
    pairs = [
        (timed_plan(BatchedRRT(), problem, start, extensions, seed)[0],
         timed_plan(OmplRRT(), problem, start, ompl_extensions, seed)[0])
        for seed in range(ROUNDS)
    ]  # fmt: skip
    return Rates.of(pairs)


def planner_vs_networks(problem: Problem, start: Float[np.ndarray, " state"], extensions: int = 10_000) -> Rates:
    """Checked transitions a second of our planner over those of its networks alone, on batches of the same size."""
    problem, planner = growing(problem), BatchedRRT()
    _, plan = timed_plan(planner, problem, start, 2000, 0)
    pairs = [
        (timed_plan(planner, problem, start, extensions, seed)[0],
         networks_alone(problem, plan, planner.lanes, extensions))
        for seed in range(ROUNDS)
    ]  # fmt: skip
    return Rates.of(pairs)


def rate_by_tree_size(
    problem: Problem, start: Float[np.ndarray, " state"], sizes: tuple[int, ...] = (1000, 5000, 20_000, 50_000)
) -> dict[int, float]:
    """Checked transitions a second while the tree has 0.8 to 1.2 of each number of nodes; medians of iterations."""
    watch, planner = Stopwatch(problem.sampler), BatchedRRT(SearchSettings(attempt_extensions=4 * max(sizes)))
    problem = replace(growing(problem), sampler=watch)
    timed_plan(planner, problem, start, int(1.5 * max(sizes)), 0)
    nodes, seconds = np.array(watch.nodes[2:]), np.diff(watch.seconds)
    rates: dict[int, float] = {}
    for size in sizes:
        near = (nodes > 0.8 * size) & (nodes < 1.2 * size)
        rates[size] = planner.lanes / float(np.median(seconds[near]))
    return rates
