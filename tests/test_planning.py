"""Laws of planning, for every planner: what a plan promises, what it may spend, and when it gives up."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import final

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fairlead.core.budget import Budget, Meter
from fairlead.core.errors import FairleadError
from fairlead.core.layout import StateLayout
from fairlead.core.records import Plan, PlanOutcome, Prediction, Transitions
from fairlead.core.roles import Dynamics, TransitionCheck
from fairlead.core.streams import stream
from fairlead.geometry.goals import point_goal
from fairlead.geometry.motion import RandomDisplacement
from fairlead.geometry.shapes import Box
from fairlead.planning.checks import AcceptAll
from fairlead.planning.middle import ToTheMiddle
from fairlead.planning.ompl import OmplRRT
from fairlead.planning.problem import Planner, Problem, SearchSettings
from fairlead.planning.relaxed import Relaxed
from fairlead.planning.rrt import BatchedRRT
from fairlead.planning.several import Several
from fairlead.planning.shorten import Shortened, expected_length
from toy import BAR, LAYOUT, SAMPLER, BrokenChain, FreeChain, Given, arena, follow, problem, straight, tail_goal

PLANNERS = [BatchedRRT(), BatchedRRT(lanes=7, candidates=20), OmplRRT(), ToTheMiddle(Shortened(BatchedRRT(lanes=7))),
            Several(BatchedRRT()), Relaxed(BatchedRRT())]  # fmt: skip
NAMES = ["batched", "seven-lanes", "ompl", "middle-short", "several", "relaxed"]
each_planner = pytest.mark.parametrize("planner", PLANNERS, ids=NAMES)
each_of_one_attempt = pytest.mark.parametrize("planner", PLANNERS[:-2], ids=NAMES[:-2])


def like(planner: Planner, settings: SearchSettings) -> Planner:
    """A planner of the same kind with other settings."""
    if isinstance(planner, ToTheMiddle):
        return ToTheMiddle(Shortened(BatchedRRT(settings, lanes=7), settings))
    return type(planner)(settings)


START = straight(-0.4, 0.0)
UNCLIPPED = RandomDisplacement(LAYOUT, 0.15, (-9, -9, 0.02), (9, 9, 0.02), planar=True)


@final
class Scripted(TransitionCheck):
    """Accepts only the transitions of the given numbers, in the order of being asked; else answers `otherwise`."""

    def __init__(self, accepted: range = range(0), otherwise: float = 0.0) -> None:
        self.accepted, self.otherwise, self.asked, self.batches, self.encoded = accepted, otherwise, 0, [], 0

    def encode(self, environment, states):
        self.encoded += len(states)
        return np.zeros((len(states), 1), np.float32)

    def probability(self, environment, transitions, encodings, next_encodings):
        numbers = self.asked + np.arange(len(transitions))
        self.asked += len(transitions)
        self.batches.append(len(transitions))
        return np.where((numbers >= self.accepted.start) & (numbers < self.accepted.stop), 1.0, self.otherwise)


@final
class Slope(TransitionCheck):
    """Trusts less the farther the gripper goes from the middle line."""

    def encode(self, environment, states):
        return states[:, 1:2].astype(np.float32)

    def probability(self, environment, transitions, encodings, next_encodings):
        return np.exp(-0.3 * np.abs(next_encodings[:, 0]))


def meter(extensions: float = 20_000) -> Meter:
    """A counted meter whose clock no planner may read."""

    def clock() -> float:
        raise AssertionError("the clock was read under a counted budget")

    return Meter(Budget(extensions=extensions), clock)


def scripted(check: TransitionCheck) -> Problem:
    return Problem(arena(), tail_goal(0.5, 0.1), FreeChain(), check, SAMPLER)


@each_planner
@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32), extensions=st.integers(1, 1200), heading=st.floats(-3, 3))
def test_a_plan_is_a_chain_of_accepted_transitions(planner, seed, extensions, heading):
    task, spent = problem(arena(BAR), tail_goal(0.5, 0.1)), meter(extensions)
    start = straight(-0.45, 0.0, heading)
    plan = planner.plan(task, start, spent, stream(seed))
    assert plan.extensions == spent.extensions <= extensions
    assert len(plan.states) == len(plan.actions) + 1 == len(plan.trust) + 1
    assert np.array_equal(plan.states[0], start)
    assert (plan.trust > 0.5).all()
    assert task.environment.contains(plan.states[1:]).all()
    predicted = task.dynamics.predict(task.environment, plan.states[:-1], plan.actions).mean
    assert np.allclose(predicted, plan.states[1:])
    encodings = task.check.encode(task.environment, plan.states)
    again = Transitions(plan.states[:-1], plan.actions, plan.states[1:], np.zeros(len(plan)))
    assert (task.check.probability(task.environment, again, encodings[:-1], encodings[1:]) > 0.5).all()
    assert (plan.outcome is PlanOutcome.GOAL) == bool(task.goal.reached(plan.states[-1]))
    reach = np.linalg.norm(plan.actions - plan.states[:-1, :3], axis=1)
    assert (reach <= SAMPLER.reach + 1e-9).all()


@each_planner
@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_the_tree_is_a_tree_and_the_plan_leads_to_its_best_node(planner, seed):
    task = problem(arena(BAR), tail_goal(0.5, 0.1, radius=1e-6))
    plan = planner.plan(task, START, meter(400), stream(seed))
    assert plan.outcome is PlanOutcome.PARTIAL
    assert plan.tree is not None
    assert len(plan.tree.states) == plan.nodes <= plan.extensions + 1
    assert (plan.tree.parents[1:] < np.arange(1, plan.nodes)).all()
    errors = task.goal.error(plan.tree.states)
    assert task.goal.error(plan.states[-1]) == errors.min()


@each_planner
def test_the_same_arguments_give_the_same_plan_and_another_seed_another(planner):
    task = problem(arena(BAR), tail_goal(0.5, 0.1))
    first, second, other = (planner.plan(task, START, meter(300), stream(seed)) for seed in (3, 3, 4))
    assert np.array_equal(first.tree.states, second.tree.states)
    assert np.array_equal(first.actions, second.actions)
    assert not np.array_equal(first.tree.states[:50], other.tree.states[:50])


@each_planner
def test_stuck_after_32_rejected_attempts_at_the_start(planner):
    check = Scripted()
    plan = planner.plan(scripted(check), START, meter(), stream(0))
    assert plan.outcome is PlanOutcome.STUCK
    assert (plan.extensions, plan.nodes, len(plan), check.asked) == (32, 1, 0, 32)


@each_planner
@pytest.mark.parametrize("number", [0, 15, 31])
def test_one_accepted_attempt_is_not_stuck(planner, number):
    plan = planner.plan(scripted(Scripted(range(number, number + 1))), START, meter(300), stream(0))
    assert plan.outcome is PlanOutcome.PARTIAL
    assert (plan.extensions, plan.nodes) == (300, 2)


@each_planner
def test_what_is_not_a_number_is_rejected_and_counted(planner):
    nan_check = planner.plan(scripted(Scripted(otherwise=np.nan)), START, meter(), stream(0))
    assert (nan_check.outcome, nan_check.invalid) == (PlanOutcome.STUCK, 32)
    nothing_known = Problem(arena(), tail_goal(0.5, 0.1), BrokenChain(beyond=-9.0), AcceptAll(), SAMPLER)
    nan_dynamics = planner.plan(nothing_known, START, meter(), stream(0))
    assert (nan_dynamics.outcome, nan_dynamics.invalid) == (PlanOutcome.STUCK, 32)
    broken = planner.plan(problem(arena(), tail_goal(0.5, 0.1), BrokenChain()), START, meter(1000), stream(0))
    assert broken.invalid > 0
    assert np.isfinite(broken.tree.states).all()
    assert (broken.tree.states[:, 0] <= 0).all()


@each_planner
def test_nothing_leaves_the_bounds_even_where_everything_is_trusted(planner):
    task = Problem(arena(), tail_goal(0.5, 0.1, radius=1e-6), FreeChain(), AcceptAll(), UNCLIPPED)
    tree = planner.plan(task, straight(0.9, 0.0), meter(300), stream(0)).tree
    assert len(tree.states) < 301
    assert task.environment.contains(tree.states).all()


@final
class SinglePrecision(Dynamics):
    """The chain as a network predicts it: not to the last bit."""

    layout = LAYOUT

    def predict(self, environment, states, actions):
        mean = follow(states, actions.reshape(-1, 1, 3)).astype(np.float32)
        return Prediction(mean + np.float32(1e-5) * np.sign(mean), np.zeros(len(mean)))


@pytest.mark.parametrize("trust", [np.ones((3, 1)), np.full(3, 90.0), None])
def test_what_is_no_probability_is_named(trust):
    check = Scripted()
    check.probability = lambda *asked: trust
    task = Problem(arena(), tail_goal(0.5, 0.1), FreeChain(), check, SAMPLER)
    starts = np.stack([START] * 3)
    with pytest.raises(FairleadError, match=r"Scripted: .*probability"):
        task.attempt(starts, SAMPLER.propose(starts, stream(0)), np.zeros((3, 1)))


def test_what_is_sent_to_the_bounds_is_not_lost_by_rounding():
    task = Problem(arena(), tail_goal(0.5, 0.1), SinglePrecision(), AcceptAll(), SAMPLER)
    starts = np.stack([straight(0.9, 0.0)] * 200)
    actions = SAMPLER.propose(starts, stream(0))
    assert 0 < (actions[:, 0] == 0.95).sum() < 200
    assert task.attempt(starts, actions, task.check.encode(task.environment, starts)).accepted.all()


@each_of_one_attempt
@pytest.mark.parametrize(("budget_s", "attempt_s"), [(3.0, 1.0), (1.0, 3.0)])
def test_seconds_end_an_attempt(planner, budget_s, attempt_s):
    ticks = itertools.count(step=0.05)
    timed = Meter(Budget(seconds=budget_s), lambda: next(ticks))
    timed.start_planning()
    unreachable = problem(arena(), tail_goal(0.5, 0.1, radius=1e-6))
    plan = like(planner, SearchSettings(attempt_seconds=attempt_s)).plan(unreachable, START, timed, stream(0))
    assert plan.outcome is PlanOutcome.PARTIAL
    assert timed.spent_s == pytest.approx(1.0, abs=0.3)


@each_of_one_attempt
def test_an_attempt_stays_within_its_own_extensions(planner):
    unreachable = problem(arena(), tail_goal(0.5, 0.1, radius=1e-6))
    short = like(planner, SearchSettings(attempt_extensions=100))
    assert short.plan(unreachable, START, meter(), stream(0)).extensions == 100


@each_planner
def test_a_start_in_the_goal_needs_no_action(planner):
    plan = planner.plan(problem(arena(), tail_goal(-0.7, 0.0)), START, meter(), stream(0))
    assert (plan.outcome, len(plan), plan.extensions) == (PlanOutcome.GOAL, 0, 0)


def test_every_iteration_is_one_full_batch_and_encodes_only_what_is_new():
    check = Scripted(range(100_000))
    BatchedRRT(lanes=64).plan(scripted(check), START, meter(2000), stream(0))
    assert check.batches[0] == 32
    assert set(check.batches[1:-1]) == {64}
    assert check.encoded == check.asked + 1


@given(repeats=st.integers(1, 6), seed=st.integers(0, 1000))
@settings(max_examples=10, deadline=None)
def test_a_control_is_repeated_at_most_so_often(repeats, seed):
    planner = BatchedRRT(SearchSettings(repeats=repeats), lanes=8)
    task = Problem(arena(), tail_goal(9, 9), FreeChain(), AcceptAll(), UNCLIPPED)
    tree = planner.plan(task, START, meter(500), stream(seed)).tree
    moved = (tree.states - tree.states[tree.parents])[1:, :2]
    _, same = np.unique(moved.round(9), axis=0, return_counts=True)
    assert same.max() <= repeats


def test_ompl_pays_for_each_transition_once():
    task, spent = Problem(arena(), tail_goal(9, 9), FreeChain(), AcceptAll(), UNCLIPPED), meter(300)
    tree = OmplRRT().plan(task, START, spent, stream(0)).tree
    assert 200 < len(np.unique(tree.states, axis=0)) == len(tree.states)


def test_both_planners_solve_the_same_problems_at_a_similar_rate():
    solved = {BatchedRRT: 0, OmplRRT: 0}
    spent = {BatchedRRT: 0, OmplRRT: 0}
    for seed in range(8):
        rng = stream(1, seed)
        bar = Box((0.1, float(rng.uniform(0.3, 0.6)), 0.3), (float(rng.uniform(-0.1, 0.1)), 0.0, 0.15))
        task = problem(arena(bar), tail_goal(0.3, float(rng.uniform(-0.3, 0.3)), 0.1))
        start = straight(-0.3, float(rng.uniform(-0.3, 0.3)))
        for planner in (BatchedRRT(lanes=16), OmplRRT()):
            plan = planner.plan(task, start, meter(2000), stream(0, seed))
            solved[type(planner)] += plan.outcome is PlanOutcome.GOAL
            spent[type(planner)] += plan.extensions
    assert min(solved.values()) >= 6
    assert abs(solved[BatchedRRT] - solved[OmplRRT]) <= 2
    assert 1 / 3 < spent[BatchedRRT] / spent[OmplRRT] < 3


def test_settings_that_make_no_sense_are_refused():
    for threshold in (0.05, 1.0):
        with pytest.raises(FairleadError, match="threshold"):
            replace(problem(arena(), tail_goal(9, 9)), threshold=threshold)
    for wrong in ({"goal_bias": 2}, {"repeats": 0}, {"attempt_seconds": -1}):
        with pytest.raises(FairleadError):
            SearchSettings(**wrong)
    with pytest.raises(FairleadError):
        BatchedRRT(lanes=0)


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32), share=st.floats(0.2, 1.0))
def test_plans_to_the_middle_end_there(seed, share):
    task = problem(arena(BAR), tail_goal(0.5, 0.1))
    plan = ToTheMiddle(BatchedRRT(), share).plan(task, START, meter(), stream(seed))
    assert plan.outcome is PlanOutcome.GOAL
    assert task.goal.error(plan.states[-1]) <= share * task.goal.tolerance


@final
class TwoPoints(Dynamics):
    """Two grippers that hold nothing and arrive where they are sent."""

    layout = StateLayout(("left", "right"), 0)

    def predict(self, environment, states, actions):
        return Prediction(actions, np.zeros(len(actions)))


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_shortening_never_lengthens_what_is_expected_and_pays_for_each_transition(seed):
    task = replace(problem(arena(BAR), tail_goal(0.5, 0.1)), check=Slope())
    found, spent = BatchedRRT().plan(task, START, meter(), stream(seed)), meter()
    short = Shortened(Given(found)).plan(task, START, spent, stream(seed))
    assert short.outcome is PlanOutcome.GOAL
    assert expected_length(short, task) < expected_length(found, task)
    assert short.extensions - found.extensions == spent.extensions
    assert task.goal.reached(short.states[-1])
    again = task.attempt(short.states[:-1], short.actions, task.check.encode(task.environment, short.states[:-1]))
    assert again.accepted.all()
    assert np.allclose(again.next_states, short.states[1:])
    assert np.allclose(again.trust, short.trust)
    same = Shortened(Given(found)).plan(task, START, meter(), stream(seed))
    assert np.array_equal(same.actions, short.actions)


def test_shortening_makes_a_detour_straight():
    task = replace(problem(arena(), tail_goal(0.5, 0.0)), check=AcceptAll())
    there = np.linspace(0, np.pi, 16)[1:]
    detour = START[:3] + np.stack([0.5 * (1 - np.cos(there)), 0.5 * np.sin(there), np.zeros(15)], axis=1)
    states = [START]
    for action in detour:
        states.append(task.dynamics.predict(task.environment, states[-1][None], action[None]).mean[0])
    found = Plan(PlanOutcome.GOAL, np.stack(states), detour, np.ones(15), 15, 16)
    task = replace(task, goal=point_goal(LAYOUT, "gripper", tuple(detour[-1]), 0.05))
    short = Shortened(Given(found), rounds=16).plan(task, START, meter(), stream(0))
    straight_m = np.linalg.norm(detour[-1] - START[:3])
    before, after = (np.linalg.norm(np.diff(p.states[:, :3], axis=0), axis=1).sum() for p in (found, short))
    assert before > 1.5 * straight_m
    assert after < 1.1 * straight_m


@pytest.mark.parametrize(("off", "chance"), [(0.0, 1.0), (0.02, 0.8), (0.05, 0.5)])
def test_expected_length_is_the_way_of_the_farthest_gripper_over_the_chance(off, chance):
    goal = point_goal(TwoPoints.layout, "left", (0.3 + off, 0.4, 0.0), 0.05)
    states = np.array([[0, 0, 0, 1, 0, 0], [0.3, 0.4, 0, 1, 0, 0], [0.3, 0.4, 0, 1, 0, 0.2]], float)
    plan = Plan(PlanOutcome.GOAL, states, states[1:], np.array([0.8, 0.5]), 2, 3)
    task = problem(arena(), goal, TwoPoints())
    assert expected_length(plan, task) == pytest.approx((0.5 + 0.2) / (0.8 * 0.5 * chance))


@pytest.mark.parametrize("left", [1, 40, 500])
def test_shortening_keeps_within_the_limits_of_the_attempt_and_of_the_trial(left):
    task = problem(arena(BAR), tail_goal(0.5, 0.1))
    found = BatchedRRT().plan(task, START, meter(), stream(3))
    for spent, limit in ((meter(left), 20_000), (meter(), left)):
        short = Shortened(Given(found), SearchSettings(attempt_extensions=limit)).plan(task, START, spent, stream(0))
        assert short.outcome is PlanOutcome.GOAL
        assert short.extensions - found.extensions == spent.extensions
        assert 0 < spent.extensions <= left
    late = Meter(Budget(seconds=1), lambda: 0.0, planning_s=1)
    assert np.array_equal(Shortened(Given(found)).plan(task, START, late, stream(0)).actions, found.actions)
    assert late.extensions == 0


def test_the_end_of_a_plan_of_one_action_is_moved():
    task = replace(problem(arena(), tail_goal(0.5, 0.0)), check=AcceptAll())
    action = START[None, :3] + [[0.1, 0, 0]]
    end = FreeChain().predict(task.environment, START[None], action).mean
    task = replace(task, goal=tail_goal(*(end[0, 3:5] + [0.0, 0.04]), radius=0.05))
    plan, spent = Plan(PlanOutcome.GOAL, np.stack([START, end[0]]), action, np.ones(1), 0, 3), meter()
    short = Shortened(Given(plan), rounds=3, candidates=16).plan(task, START, spent, stream(0))
    assert len(short) == 1
    assert np.linalg.norm(short.actions - action) <= task.goal.tolerance
    assert expected_length(short, task) < expected_length(plan, task)
    assert spent.extensions == short.extensions == 3 * 16


@pytest.mark.parametrize(("radius", "outcome"), [(1e-6, PlanOutcome.PARTIAL), (None, PlanOutcome.GOAL)])
def test_a_plan_that_misses_the_goal_is_brought_nearer_and_in_where_it_can_be(radius, outcome):
    task = problem(arena(BAR), tail_goal(0.5, 0.1, radius=1e-6))
    found = BatchedRRT().plan(task, START, meter(4000), stream(0))
    assert found.outcome is PlanOutcome.PARTIAL
    missed = float(task.goal.error(found.states[-1]))
    task = replace(task, goal=tail_goal(0.5, 0.1, radius=radius or missed - 0.005))
    spent = meter()
    short = Shortened(Given(found)).plan(task, START, spent, stream(0))
    assert short.outcome is outcome
    assert task.goal.error(short.states[-1]) < missed
    assert short.extensions - found.extensions == spent.extensions > 0
    assert (short.trust > 0.5).all()


@final
class Doubtful(TransitionCheck):
    """Trusts every transition as much, and a wall of the arena's middle less."""

    def __init__(self, at_best: float, across: float) -> None:
        self.at_best, self.across = at_best, across

    def encode(self, environment, states):
        return states[:, :1].astype(np.float32)

    def probability(self, environment, transitions, encodings, next_encodings):
        return np.where((encodings < 0) == (next_encodings < 0), self.at_best, self.across)[:, 0]


BEYOND = replace(problem(arena(), tail_goal(0.3, 0.0, 0.1)), check=Doubtful(0.9, 0.2))
FEW = SearchSettings(attempt_extensions=3000)


def test_less_trust_is_asked_for_only_where_enough_does_not_lead_to_the_goal() -> None:
    """The way across is trusted with 0.2: not at 0.5, not at 0.25, but at 0.1."""
    spent = meter()
    assert BatchedRRT(FEW).plan(BEYOND, START, meter(), stream(0)).outcome is PlanOutcome.PARTIAL
    plan = Relaxed(BatchedRRT(FEW)).plan(BEYOND, START, spent, stream(0))
    assert plan.outcome is PlanOutcome.GOAL
    assert min(plan.trust) == 0.2
    assert spent.extensions == plan.extensions > 6000, "two attempts failed before"
    near = replace(BEYOND, goal=tail_goal(-0.6, 0.2, 0.1))
    alone = BatchedRRT(FEW).plan(near, START, meter(), stream(1))
    same = Relaxed(BatchedRRT(FEW)).plan(near, START, meter(), stream(1))
    assert alone.outcome is PlanOutcome.GOAL
    assert np.array_equal(same.actions, alone.actions)
    assert same.extensions == alone.extensions


def test_where_no_trust_leads_to_the_goal_the_most_trusted_plan_is_returned() -> None:
    closed, spent = replace(BEYOND, check=Doubtful(0.9, 0.0)), meter()
    alone = BatchedRRT(FEW).plan(closed, START, meter(), stream(0))
    plan = Relaxed(BatchedRRT(FEW)).plan(closed, START, spent, stream(0))
    assert plan.outcome is PlanOutcome.PARTIAL
    assert np.array_equal(plan.actions, alone.actions)
    assert spent.extensions == plan.extensions == 9000


def test_a_stuck_start_is_left_to_recovery() -> None:
    """Even where a little trust would lead on."""
    spent = meter()
    plan = Relaxed(BatchedRRT()).plan(replace(BEYOND, check=Doubtful(0.4, 0.4)), START, spent, stream(0))
    assert plan.outcome is PlanOutcome.STUCK
    assert spent.extensions == plan.extensions < 100


@pytest.mark.parametrize("wrong", [(0.25, 0.05), (1.0,)])
def test_what_no_check_vouches_for_is_no_threshold(wrong: tuple[float, ...]) -> None:
    with pytest.raises(FairleadError, match="thresholds"):
        Relaxed(BatchedRRT(), wrong)


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_of_several_plans_the_shortest_is_kept_and_all_are_paid_for(seed):
    task, spent = replace(problem(arena(BAR), tail_goal(0.5, 0.1)), check=Slope()), meter()
    rng, plans = stream(seed), []
    plan = Several(BatchedRRT(), 1000).plan(task, START, spent, stream(seed))
    while sum(p.extensions for p in plans) < plan.extensions:
        plans.append(BatchedRRT().plan(task, START, meter(), rng))
    assert spent.extensions == plan.extensions == sum(p.extensions for p in plans)
    reached = [p for p in plans if p.outcome is PlanOutcome.GOAL]
    best = min(reached, key=lambda p: expected_length(p, task))
    assert np.array_equal(plan.actions, best.actions)
    assert 1000 * len(best) <= plan.extensions
    if before := [p for p in plans[:-1] if p.outcome is PlanOutcome.GOAL]:
        assert plan.extensions - plans[-1].extensions < 1000 * len(min(before, key=lambda p: expected_length(p, task)))


def test_several_plans_are_better_than_one_where_the_first_is_long():
    task = replace(problem(arena(BAR), tail_goal(0.5, 0.1)), check=Slope())
    one, many = (
        np.mean([expected_length(planner.plan(task, START, meter(), stream(seed)), task) for seed in range(10)])
        for planner in (BatchedRRT(), Several(BatchedRRT(), 1000))
    )
    assert many < 0.8 * one


@pytest.mark.parametrize(("goal", "check", "extensions", "outcome"), [
    (tail_goal(0.3, 0.0, 0.1), Doubtful(0.9, 0.2), 500, PlanOutcome.PARTIAL),
    (tail_goal(-0.6, 0.2, 0.1), AcceptAll(), 1, PlanOutcome.GOAL),
    (tail_goal(*START[3:5]), AcceptAll(), 500, PlanOutcome.GOAL),
])  # fmt: skip
def test_there_is_one_attempt_where_it_fails_or_its_plan_is_short(goal, check, extensions, outcome):
    task = replace(problem(arena(), goal), check=check)
    alone = BatchedRRT(FEW).plan(task, START, meter(), stream(0))
    same = Several(BatchedRRT(FEW), extensions).plan(task, START, meter(), stream(0))
    assert same.outcome is alone.outcome is outcome
    assert np.array_equal(same.actions, alone.actions)
    assert same.extensions == alone.extensions


def test_several_needs_a_positive_number_of_extensions():
    with pytest.raises(FairleadError, match="extensions 0"):
        Several(BatchedRRT(), 0)
