"""Laws of labelling: examples against their definition, computed one at a time."""

from __future__ import annotations

from typing import final

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jaxtyping import Float

from fairlead.core.errors import UnknownNameError
from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome, Prediction, Trajectories
from fairlead.core.roles import Dynamics, Environment
from fairlead.geometry.distance import model_error
from fairlead.learning import labels, rollout
from fairlead.learning.labels import CUT_BY_ARMS, FIGURE_STEPS, RULES, label
from fairlead.learning.metrics import auroc, classification
from rope_data import LAYOUT, follow, trajectories

DELTA = 0.03


@final
class FollowDynamics(Dynamics):
    """The true motion without obstacles, plus a known error in each step."""

    def __init__(self, bias: float) -> None:
        self.bias = bias

    @property
    def layout(self) -> StateLayout:
        return LAYOUT

    def predict(
        self,
        environment: Environment,
        states: Float[np.ndarray, "batch state"],
        actions: Float[np.ndarray, "batch action"],
    ) -> Prediction:
        moved = follow(states, actions)
        moved[:, LAYOUT.action_size] += self.bias
        return Prediction(moved.astype(np.float32), np.abs(actions[:, 0]).astype(np.float32))


@final
class AmongDynamics(Dynamics):
    """The true motion without obstacles, plus an error that tells the environments apart."""

    layout = LAYOUT

    def predict(
        self,
        environment: Environment,
        states: Float[np.ndarray, "batch state"],
        actions: Float[np.ndarray, "batch action"],
    ) -> Prediction:
        moved = follow(states, actions)
        moved[:, LAYOUT.action_size] += 0.01 * environment.signed_distance(np.zeros((1, 3)))[0]
        return Prediction(moved.astype(np.float32), np.abs(actions[:, 0]).astype(np.float32))


@pytest.mark.parametrize("rule", RULES)
def test_every_trajectory_is_rolled_out_in_its_own_environment(rule: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """However trajectories are batched, and in whatever order their scenes come."""
    monkeypatch.setattr(rollout, "_ROWS", 3)
    monkeypatch.setattr(labels, "_TRAJECTORIES", 4)
    data = trajectories(11, 5, 4, np.random.default_rng(3))
    together = label(AmongDynamics(), data, 0.05, rule)
    for n in range(len(data)):
        of = together.source[:, 0] == n
        one = slice(n, n + 1)
        where = [data.environments[data.scene[n]]]
        alone = Trajectories(LAYOUT, data.states[one], data.actions[one], data.outcomes[one], np.zeros(1, int), where)
        found = label(AmongDynamics(), alone, 0.05, rule)
        np.testing.assert_array_equal(together.transitions.next_states[of], found.transitions.next_states)
        np.testing.assert_array_equal(together.source[of, 1:], found.source[:, 1:])
        assert (together.scene[of] == data.scene[n]).all()


@given(seed=st.integers(0, 500), bias=st.sampled_from([0.0, 0.004, 0.02]))
@settings(max_examples=12, deadline=None)
def test_figure_rule_is_its_definition(seed: int, bias: float) -> None:
    data = trajectories(4, 5, 2, np.random.default_rng(seed))
    dynamics = FollowDynamics(bias)
    found = label(dynamics, data, DELTA)
    expected = {}
    for n in range(4):
        for first in range(5):
            s_hat = data.states[n, first].astype(np.float32)
            for t in range(first, min(5, first + FIGURE_STEPS)):
                s_next = dynamics.predict(None, s_hat[None], data.actions[n, t : t + 1].astype(np.float32)).mean[0]  # type: ignore[arg-type]
                if model_error(LAYOUT, s_hat, data.states[n, t]) < DELTA:
                    expected[n, first, t] = (s_hat, s_next, model_error(LAYOUT, s_next, data.states[n, t + 1]))
                s_hat = s_next
    assert {tuple(row) for row in found.source.tolist()} == set(expected)
    assert len(found) == len(expected)
    for row, source in enumerate(map(tuple, found.source.tolist())):
        s_hat, s_next, error = expected[source]
        np.testing.assert_allclose(found.transitions.states[row], s_hat, atol=1e-5)
        np.testing.assert_allclose(found.transitions.next_states[row], s_next, atol=1e-5)
        np.testing.assert_allclose(found.transitions.actions[row], data.actions[source[0], source[2]], atol=1e-6)
        assert found.transitions.spread[row] == pytest.approx(abs(data.actions[source[0], source[2], 0]), abs=1e-6)
        assert found.labels[row] == (error < DELTA)
        assert found.scene[row] == data.scene[source[0]]


@given(seed=st.integers(0, 500))
@settings(max_examples=12, deadline=None)
def test_text_rule_drops_what_follows_the_first_zero(seed: int) -> None:
    data = trajectories(6, 7, 3, np.random.default_rng(seed))
    found = label(FollowDynamics(0.008), data, DELTA, rule="text")
    for n in range(6):
        rows = np.flatnonzero(found.source[:, 0] == n)
        assert (found.source[rows, 1] == 0).all()
        assert (found.source[rows, 2] == np.arange(len(rows))).all()
        assert found.labels[rows][:-1].all()
        assert len(rows) == 7 or not found.labels[rows[-1]]


@pytest.mark.parametrize("rule", RULES)
@given(seed=st.integers(0, 500), delta=st.sampled_from([0.0, 0.008, 0.02, DELTA, 0.06]))
@settings(max_examples=12, deadline=None)
def test_a_smaller_delta_needs_no_new_rollouts(rule: str, seed: int, delta: float) -> None:
    data, dynamics = trajectories(6, 7, 3, np.random.default_rng(seed)), FollowDynamics(0.008)
    found, anew = label(dynamics, data, 0.06, rule).at(delta), label(dynamics, data, delta, rule)
    for name in ("labels", "error", "before", "scene", "source"):
        np.testing.assert_array_equal(getattr(found, name), getattr(anew, name))
    for name in ("states", "actions", "next_states", "spread"):
        np.testing.assert_array_equal(getattr(found.transitions, name), getattr(anew.transitions, name))


def test_a_perfect_model_is_always_reliable_where_nothing_is_in_the_way() -> None:
    data = trajectories(5, 6, 0, np.random.default_rng(0))
    counts = {rule: label(FollowDynamics(0.0), data, DELTA, rule).counts() for rule in RULES}
    assert counts == {
        "figure": {"examples": 5 * (6 + 5 + 4 + 3 + 2 + 1), "reliable": 1.0},
        "text": {"examples": 5 * 6, "reliable": 1.0},
    }


def test_a_sample_is_seeded_and_of_the_same_examples() -> None:
    whole = label(FollowDynamics(0.0), trajectories(6, 6, 2, np.random.default_rng(1)), DELTA)
    one, same = (whole.sample(20, np.random.default_rng(4)) for _ in range(2))
    assert len(one) == 20
    assert {tuple(row) for row in one.source.tolist()} < {tuple(row) for row in whole.source.tolist()}
    assert (one.source == same.source).all()


@pytest.mark.parametrize("rule", RULES)
def test_what_the_arms_cut_short_may_be_left_out_and_nothing_else(rule: str) -> None:
    rng = np.random.default_rng(2)
    data = trajectories(6, 6, 2, rng)
    cut = ActionOutcome.JOINT_LIMIT.number
    data.outcomes[:] = rng.choice([0, cut], data.outcomes.shape)
    whole, known = (label(FollowDynamics(0.0), data, DELTA, rule, leave_out=o) for o in ((), CUT_BY_ARMS))
    kept = data.outcomes[whole.source[:, 0], whole.source[:, 2]] != cut
    assert 0 < kept.sum() < len(kept)
    np.testing.assert_array_equal(known.source, whole.source[kept])
    np.testing.assert_array_equal(known.labels, whole.labels[kept])


def test_unknown_rule() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'figure'"):
        label(FollowDynamics(0.0), trajectories(1, 2, 0, np.random.default_rng(0)), DELTA, rule="figur")


@given(st.lists(st.tuples(st.integers(0, 5), st.booleans()), min_size=2, max_size=30))
@settings(max_examples=50, deadline=None)
def test_auroc_is_the_chance_that_a_positive_scores_higher(pairs: list[tuple[int, bool]]) -> None:
    score, positive = np.array([p for p, _ in pairs]) / 5, np.array([y for _, y in pairs])
    if positive.all() or not positive.any():
        assert np.isnan(auroc(score, positive))
        return
    difference = score[positive][:, None] - score[~positive]
    assert auroc(score, positive) == pytest.approx(((difference > 0) + 0.5 * (difference == 0)).mean())


def test_classification_by_hand() -> None:
    found = classification(np.array([0.9, 0.8, 0.4, 0.1]), np.array([True, False, True, False]))
    assert (found["accuracy"], found["precision"], found["recall"], found["auroc"]) == (0.5, 0.5, 0.5, 0.75)
    assert sum(row["count"] for row in found["reliability"]) == 4
