"""Laws of remembering what was cut short."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import event, given, settings
from hypothesis import strategies as st

import toy
from fairlead.core import contracts
from fairlead.core.budget import Budget, Meter
from fairlead.core.layout import StateLayout
from fairlead.core.roles import RecoveryPolicy
from fairlead.geometry.motion import RandomDisplacement
from fairlead.planning.memory import CutShort, DoubtfulRecovery, UntriedActions
from fairlead.planning.problem import Problem
from fairlead.planning.recovery import NoRecovery, RandomRecovery
from fairlead.planning.rrt import BatchedRRT
from fairlead.planning.shorten import Shortened
from toy import Given, arena, problem, straight, tail_goal

LAYOUT = StateLayout(("left", "right"), 4)
SAMPLER = RandomDisplacement(LAYOUT, 0.15, (-1.0, -1.0, 0.0), (1.0, 1.0, 1.0), planar=False)
STATES = np.tile(np.full(LAYOUT.state_size, 0.5), (64, 1))
UP = np.tile([0.0, 0.0, 0.1], 2)


def remembering(*ways: np.ndarray) -> CutShort:
    tried = CutShort(LAYOUT)
    for way in ways:
        tried.add(STATES[0], STATES[0, :6] + way, STATES[0])
    return tried


@given(scale=st.floats(0.1, 3), off=st.floats(0, 0.049), turn=st.floats(0, 59))
def test_the_same_way_from_about_the_same_place_is_covered_whatever_its_length(
    scale: float, off: float, turn: float
) -> None:
    state = STATES[:1].copy()
    state[:, 0] += off
    way = scale * 0.1 * np.tile([np.sin(np.radians(turn)), 0.0, np.cos(np.radians(turn))], 2)
    assert remembering(UP).covers(state, state[:, :6] + way).all()


def test_an_action_counts_where_it_began_and_where_it_ended() -> None:
    begin, end, tried = STATES[:1], STATES[:1].copy(), CutShort(LAYOUT)
    end[:, :6] += 0.7 * UP
    tried.add(begin[0], begin[0, :6] + UP, end[0])
    between = (begin + end) / 2 + 0.02
    for state, expected in ((begin, 1), (end, 1), (begin - 0.1, 0)):
        assert tried.count(state) == expected
        assert tried.covers(state, state[:, :6] + UP) == bool(expected)
    assert tried.count(between) == 1


def test_another_way_another_place_and_another_trial_are_not() -> None:
    tried, here = remembering(UP), STATES[:1]
    sideways = np.tile([0.1, 0.0, 0.0], 2)
    elsewhere = here.copy()
    elsewhere[:, 3] += 0.06
    assert not tried.covers(here, here[:, :6] + sideways).any()
    assert not tried.covers(here, here[:, :6] - UP).any()
    assert not tried.covers(elsewhere, elsewhere[:, :6] + UP).any()
    assert (tried.count(here), tried.count(elsewhere)) == (1, 0)
    tried.forget()
    assert not tried.covers(here, here[:, :6] + UP).any()
    assert tried.count(here) == 0


def test_what_was_tried_is_not_proposed_and_without_memories_nothing_changes() -> None:
    tried = remembering(UP, -UP)
    actions = UntriedActions(SAMPLER, tried).propose(STATES, np.random.default_rng(0))
    assert not tried.covers(STATES, actions).any()
    fresh = UntriedActions(SAMPLER, remembering())
    plain = SAMPLER.propose(STATES, np.random.default_rng(0))
    assert tried.covers(STATES, plain).any()
    np.testing.assert_array_equal(fresh.propose(STATES, np.random.default_rng(0)), plain)
    contracts.check_sampler(UntriedActions(SAMPLER, tried), STATES, LAYOUT)


def test_a_policy_is_doubted_by_half_with_each_failure() -> None:
    class Always(RecoveryPolicy):
        def choose(self, environment, states, rng):
            return states[:, :6] + UP

    many = np.tile(STATES, (20, 1))
    for failures in range(4):
        tried = remembering(*[-UP] * failures)
        policy = DoubtfulRecovery(Always(), RandomRecovery(UntriedActions(SAMPLER, tried)), tried)
        kept = np.isclose(policy.choose(arena(), many, np.random.default_rng(1)), many[:, :6] + UP).all(axis=1)
        assert abs(kept.mean() - 0.5**failures) < 0.05
    asked = RandomRecovery(SAMPLER)
    asked.extensions = 7
    counted = DoubtfulRecovery(Always(), asked, tried)
    counted.choose(arena(), many, np.random.default_rng(1))
    assert counted.extensions == 7
    nobody = DoubtfulRecovery(NoRecovery(), RandomRecovery(SAMPLER), remembering(UP))
    assert nobody.choose(arena(), many, np.random.default_rng(1)) is None
    contracts.check_recovery(nobody, arena(), STATES, LAYOUT)


@given(seed=st.integers(0, 2**32))
@settings(max_examples=20, deadline=None)
def test_no_plan_is_made_shorter_by_what_was_cut_short(seed: int) -> None:
    start, tried = straight(-0.4, 0.0), CutShort(toy.LAYOUT)
    for heading in np.linspace(-np.pi / 2, np.pi / 2, 4):
        tried.add(start, start[:3] + 0.1 * np.array([np.cos(heading), np.sin(heading), 0.0]), start)
    task, spent = problem(arena(), tail_goal(0.3, 0.0)), Meter(Budget(extensions=20_000), lambda: 0.0)
    remembering = replace(task, sampler=UntriedActions(toy.SAMPLER, tried))
    found = BatchedRRT().plan(remembering, start, spent, np.random.default_rng(seed))

    def straightened(of: Problem) -> bool:
        plan = Shortened(Given(found)).plan(of, start, spent, np.random.default_rng(seed))
        new = ~(plan.actions[:, None] == found.actions).all(axis=-1).any(axis=-1)
        return bool((new & tried.covers(plan.states[:-1], plan.actions)).any())

    assert not straightened(remembering)
    event(f"without memory: {straightened(task)}")
