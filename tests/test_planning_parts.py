"""Laws of the planner's parts: metric, targets, tree, checks, recovery, and the contract of every role."""

from __future__ import annotations

from dataclasses import replace
from typing import final

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fairlead.core import contracts
from fairlead.core.budget import Budget, Meter
from fairlead.core.errors import FairleadError
from fairlead.core.layout import StateLayout
from fairlead.core.records import PlanOutcome, Prediction, Transitions
from fairlead.core.roles import Dynamics, TransitionCheck
from fairlead.planning.checks import AcceptAll, CollisionCheck, SpreadThreshold
from fairlead.planning.memory import CutShort, UntriedActions
from fairlead.planning.metric import Metric
from fairlead.planning.problem import Tried
from fairlead.planning.recovery import NoRecovery, PlannedRecovery, RandomRecovery
from fairlead.planning.rrt import BatchedRRT
from fairlead.planning.targets import Targets
from fairlead.planning.tree import Tree
from toy import BAR, LAYOUT, LINK, RADIUS, SAMPLER, FreeChain, ToyWorld, arena, problem, straight, tail_goal

TWO_ARMS = StateLayout(("left", "right"), 5)
ROBOT = StateLayout(("robot",), 0)
seeds = st.integers(0, 2**32)


def some_states(count: int = 6, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.stack([straight(*rng.uniform(-0.5, 0.5, 2), rng.uniform(-3, 3)) for _ in range(count)])


def some_transitions(seed: int = 0) -> Transitions:
    states = some_states(seed=seed)
    actions = SAMPLER.propose(states, np.random.default_rng(seed))
    prediction = FreeChain().predict(arena(), states, actions)
    return Transitions(states, actions, prediction.mean, np.random.default_rng(seed).uniform(0, 0.2, len(states)))


@given(seed=seeds, layout=st.sampled_from([LAYOUT, TWO_ARMS, ROBOT]))
def test_nearest_is_nearest_by_the_definition_of_the_distance(seed, layout):
    rng = np.random.default_rng(seed)
    targets, nodes = rng.normal(size=(4, layout.state_size)), rng.normal(size=(30, layout.state_size))
    gap = targets[:, None] - nodes
    if layout is LAYOUT:
        distance = np.linalg.norm(gap[..., :3], axis=-1) + np.linalg.norm(gap[..., 3:], axis=-1)
    else:
        distance = np.linalg.norm(gap.reshape(4, 30, -1, 3), axis=-1).sum(axis=-1)
    metric, single = Metric(layout), nodes.astype(np.float32)
    found = metric.nearest(targets.astype(np.float32), single, metric.squares(single))
    assert np.allclose(distance[np.arange(4), found], distance.min(axis=1), atol=1e-3)


@given(seed=seeds)
def test_a_target_is_a_rope_as_long_as_the_start(seed):
    task, start = problem(arena(), tail_goal(0.3, 0.3)), straight(0.1, 0.2, 1.0)
    states = Targets(task, start, 0.0).sample(20, np.random.default_rng(seed))
    chain = np.concatenate([LAYOUT.points_of(states), LAYOUT.grippers_of(states)], axis=1)
    assert np.allclose(np.linalg.norm(np.diff(chain, axis=1), axis=-1), LINK)
    middle = chain.mean(axis=1)
    low, high = task.environment.bounds
    assert ((middle >= low - 1e-9) & (middle <= high + 1e-9)).all()
    assert task.goal.reached(Targets(task, start, 1.0).sample(20, np.random.default_rng(seed))).all()


def test_the_goal_bias_is_the_share_of_targets_in_the_goal():
    task = problem(arena(), tail_goal(0.3, 0.3, radius=1e-6))
    states = Targets(task, straight(0, 0), 0.05).sample(20_000, np.random.default_rng(0))
    assert task.goal.reached(states).mean() == pytest.approx(0.05, abs=0.006)


@given(sizes=st.lists(st.integers(0, 900), min_size=1, max_size=6), seed=seeds)
@settings(max_examples=20)
def test_a_tree_keeps_what_it_was_given_however_it_grows(sizes, seed):
    rng = np.random.default_rng(seed)
    task = problem(arena(), tail_goal(0.3, 0.3))
    tree, kept, ancestors = Tree(task, straight(0, 0), candidates=10), [straight(0, 0)], [0]
    for size in sizes:
        states, parents = rng.normal(size=(size, LAYOUT.state_size)), rng.integers(len(tree), size=size)
        rows = rng.random(size) < 0.7
        tried = Tried(states, np.zeros((size, 1), np.float32), np.full(size, 0.9), rows, 0)
        nodes = tree.add(parents, np.zeros((size, 3)), tried, rows)
        assert np.array_equal(nodes, np.arange(len(kept), len(kept) + rows.sum()))
        kept += list(states[rows])
        ancestors += parents[rows].tolist()
    plan = tree.plan(PlanOutcome.PARTIAL, 0, 0)
    assert plan.tree is not None
    assert np.array_equal(plan.tree.states, np.array(kept))
    assert np.array_equal(plan.tree.parents, ancestors)
    errors = task.goal.error(np.array(kept))
    assert tree.best == errors.argmin()


def test_among_a_sample_the_best_node_is_always_a_candidate():
    rng = np.random.default_rng(0)
    task = problem(arena(), tail_goal(0.3, 0.3))
    tree = Tree(task, straight(0, 0), candidates=5)
    states = rng.normal(size=(5000, LAYOUT.state_size))
    states[3000] = task.goal.sample(states[[3000]], rng)
    tried = Tried(states, np.zeros((5000, 1), np.float32), np.ones(5000), np.ones(5000, bool), 0)
    tree.add(np.zeros(5000, int), np.zeros((5000, 3)), tried, tried.accepted)
    assert all(tree.nearest(states[[3000]], rng)[0] == 3001 for _ in range(20))


@given(threshold=st.floats(1e-6, 1e3), spreads=st.lists(st.floats(0, 1e3), min_size=2, max_size=2, unique=True))
def test_spread_is_accepted_below_the_threshold_and_trust_falls_with_it(threshold, spreads):
    low, high = sorted(spreads)
    pair = some_states(2)
    nothing = np.zeros((2, 0), np.float32)
    moves = Transitions(pair, pair[:, :3], pair, np.array([low, high]))
    chance = SpreadThreshold(threshold).probability(arena(), moves, nothing, nothing)
    assert chance[0] > chance[1] or high - low < 1e-9 * (threshold + high)
    for spread, trust in zip((low, high), chance, strict=True):
        if abs(spread - threshold) > 1e-9 * threshold:
            assert (trust > 0.5) == (spread < threshold)


def test_a_threshold_must_be_a_positive_number():
    for wrong in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(FairleadError):
            SpreadThreshold(wrong)


@given(x=st.floats(-0.3, 0.3))
def test_the_collision_check_accepts_exactly_what_stays_a_radius_away(x):
    check, environment = CollisionCheck(LAYOUT, RADIUS), arena(BAR)
    state = straight(x, 0.0, np.pi / 2)[None]
    encoding = check.encode(environment, state)
    moves = Transitions(state, state[:, :3], state, np.zeros(1))
    accepted = check.probability(environment, moves, encoding, encoding)[0] > 0.5
    clearance = abs(x) - BAR.size[0] / 2 - RADIUS
    assert accepted == (clearance > 0) or abs(clearance) < 0.005


@pytest.mark.parametrize(
    "check", [AcceptAll(), CollisionCheck(LAYOUT, RADIUS), SpreadThreshold(0.1)], ids=lambda c: type(c).__name__
)
def test_checks_keep_the_contract(check):
    contracts.check_transition_check(check, arena(BAR), some_transitions())


def test_the_toy_and_the_policies_keep_their_contracts():
    states = some_states()
    actions = SAMPLER.propose(states, np.random.default_rng(0))
    contracts.check_dynamics(FreeChain(), arena(), states, actions)
    contracts.check_sampler(SAMPLER, states, LAYOUT)
    contracts.check_goal(tail_goal(0.2, 0.3), states)
    contracts.check_world(ToyWorld(arena(BAR), states), actions)
    contracts.check_recovery(NoRecovery(), arena(), states, LAYOUT)
    contracts.check_recovery(RandomRecovery(SAMPLER), arena(), states, LAYOUT)
    assert NoRecovery().choose(arena(), states, np.random.default_rng(0)) is None


def test_planned_recovery_begins_the_way_that_the_weaker_check_accepts_and_else_acts_at_random():
    states = np.repeat(straight(-0.2, 0.0)[None], 8, axis=0)
    there = problem(arena(), tail_goal(0.5, 0.0))
    policy = PlannedRecovery(BatchedRRT(), there, RandomRecovery(SAMPLER))
    chosen = policy.choose(arena(), states, np.random.default_rng(0))
    drawn = SAMPLER.propose(states, np.random.default_rng(0))
    assert (chosen - states[:, :3])[:, 0].mean() > (drawn - states[:, :3])[:, 0].mean() + 0.02
    contracts.check_recovery(policy, arena(), states, LAYOUT)
    assert policy.extensions > 0
    refused = replace(there, check=CollisionCheck(LAYOUT, 10.0))
    nowhere = PlannedRecovery(BatchedRRT(), refused, RandomRecovery(SAMPLER))
    assert nowhere.choose(arena(), states, np.random.default_rng(0)).shape == drawn.shape
    assert nowhere.extensions == 32 * len(states)
    declines = PlannedRecovery(BatchedRRT(), refused, NoRecovery())
    assert declines.choose(arena(), states, np.random.default_rng(0)) is None


@settings(max_examples=25)
@given(seed=seeds, off=st.floats(0, 0.04))
def test_planned_recovery_goes_on_with_its_plan_as_long_as_that_goes_as_predicted(seed, off):
    there, state = problem(arena(), tail_goal(0.3, 0.3)), straight(-0.2, -0.2, 0.0)[None]
    plan = BatchedRRT().plan(there, state[0], Meter(Budget(extensions=2000), lambda: 0.0), np.random.default_rng(seed))
    policy, rng = PlannedRecovery(BatchedRRT(), there, NoRecovery()), np.random.default_rng(seed)
    rest = plan
    for action, predicted in zip(plan.actions, plan.states[1:], strict=True):
        assert np.array_equal(policy.choose(there.environment, state, rng)[0], action)
        assert np.array_equal(rest.actions[0], action)
        rest = rest.rest()
        state = (predicted + off * np.eye(LAYOUT.state_size)[seed % LAYOUT.state_size])[None]
    assert policy.extensions == plan.extensions
    assert len(rest) == len(rest.rest()) == 0
    assert np.array_equal(rest.rest().states, plan.states[-1:])


@pytest.mark.parametrize("other", ["rope", "obstacles", "memory", "trial", "batch"])
def test_planned_recovery_plans_anew_where_what_its_plan_was_made_for_is_no_longer_so(other):
    tried = CutShort(LAYOUT)
    there = replace(problem(arena(), tail_goal(0.3, 0.3)), sampler=UntriedActions(SAMPLER, tried))
    policy, rng = PlannedRecovery(BatchedRRT(), there, RandomRecovery(SAMPLER)), np.random.default_rng(0)
    state, environment = straight(-0.2, -0.2, 0.0), there.environment
    plan = BatchedRRT().plan(there, state, Meter(Budget(extensions=2000), lambda: 0.0), np.random.default_rng(0))
    policy.choose(environment, state[None], rng)
    now = plan.states[1]
    match other:
        case "rope":
            now = now + 0.06 * np.eye(LAYOUT.state_size)[-3]  # the last point, along x
        case "obstacles":
            environment = arena(BAR)
        case "memory":
            tried.add(now, plan.actions[1], now)
        case "trial":
            policy.forget()
        case "batch":
            now = np.stack([now, now])
    policy.choose(environment, np.atleast_2d(now), rng)
    assert policy.extensions > plan.extensions


@final
class Faulty(Dynamics):
    """Breaks the contract of dynamics in the named way."""

    layout = LAYOUT

    def __init__(self, fault: str) -> None:
        self.fault, self.calls = fault, 0

    def predict(self, environment, states, actions):
        self.calls += 1
        mean, spread = states.copy(), np.zeros(len(states))
        match self.fault:
            case "shape":
                mean = mean[:, :-1]
            case "nan":
                mean[0] = np.nan
            case "spread":
                spread -= 1.0
            case "mutates":
                states += 1.0
            case "random":
                mean += self.calls
            case "mixes rows":
                mean += states.mean(axis=0)
        return Prediction(mean, spread)


@pytest.mark.parametrize("fault", ["shape", "nan", "spread", "mutates", "random", "mixes rows"])
def test_the_contract_of_dynamics_can_fail(fault):
    states = some_states()
    with pytest.raises(AssertionError, match=r"\w+ "):
        contracts.check_dynamics(Faulty(fault), arena(), states, states[:, :3].copy())
    contracts.check_dynamics(Faulty("none"), arena(), states, states[:, :3].copy())


@final
class Overconfident(TransitionCheck):
    """A probability of 2."""

    def encode(self, environment, states):
        return np.zeros((len(states), 1), np.float32)

    def probability(self, environment, transitions, encodings, next_encodings):
        return np.full(len(transitions), 2.0)


def test_the_contract_of_a_check_can_fail():
    with pytest.raises(AssertionError, match="probability"):
        contracts.check_transition_check(Overconfident(), arena(), some_transitions())
