"""Laws of the statistics: coverage, bounds, monotony, symmetry, and agreement with closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from fairlead.evaluation.statistics import (
    error_statistics,
    mcnemar_p,
    paired_bootstrap,
    success_against,
    welch_p,
    wilson,
)

errors = st.lists(st.floats(0, 2), min_size=2, max_size=60).map(np.array)
seeds = st.integers(0, 2**32 - 1)


@given(st.integers(1, 300).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_contains_the_rate_and_mirrors(counts: tuple[int, int]) -> None:
    k, n = counts
    interval, mirror = wilson(k, n), wilson(n - k, n)
    assert 0 <= interval.low <= k / n <= interval.high <= 1
    assert interval.low == pytest.approx(1 - mirror.high, abs=1e-12)
    assert wilson(k, n, 0.99).high >= interval.high


@given(st.integers(0, 50))
def test_wilson_agrees_with_scipy(k: int) -> None:
    reference = stats.binomtest(k, 50).proportion_ci(method="wilson")
    assert (wilson(k, 50).low, wilson(k, 50).high) == pytest.approx((reference.low, reference.high), abs=1e-12)


def test_wilson_covers_what_it_promises() -> None:
    rng = np.random.default_rng(0)
    for p in (0.05, 0.3, 0.9):
        intervals = [wilson(int(k), 50) for k in rng.binomial(50, p, 2000)]
        assert np.mean([i.low <= p <= i.high for i in intervals]) > 0.92


@pytest.mark.parametrize("counts", [(0, 0), (3, 2), (-1, 5)])
def test_wilson_refuses_what_is_no_proportion(counts: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="not a proportion"):
        wilson(*counts)


@given(errors)
def test_error_statistics_are_ordered(values: np.ndarray) -> None:
    found = error_statistics(values)
    assert found["min"] <= found["median"] <= found["max"]
    assert found["min"] - 1e-12 <= found["mean"] <= found["max"] + 1e-12
    assert found["sd"] >= 0


@given(st.lists(st.one_of(st.none(), st.floats(0, 180)), min_size=1, max_size=50))
def test_success_grows_with_the_limit_and_ends_at_the_share_that_reached(times: list[float | None]) -> None:
    curve = success_against(times, np.array([-1.0, 15.0, 60.0, 180.0]))
    assert (np.diff(curve) >= 0).all()
    assert curve[0] == 0
    assert curve[-1] == np.mean([time is not None for time in times])


@pytest.mark.filterwarnings("ignore:Precision loss")
@given(errors, errors)
def test_welch_is_antisymmetric(ours: np.ndarray, theirs: np.ndarray) -> None:
    p, reverse = welch_p(ours, theirs), welch_p(theirs, ours)
    assert (p is None) == (reverse is None)
    if p is not None and reverse is not None:
        assert p + reverse == pytest.approx(1, abs=1e-9)


def test_welch_sees_a_smaller_error() -> None:
    rng = np.random.default_rng(1)
    p = welch_p(rng.normal(0.1, 0.05, 50), rng.normal(0.3, 0.2, 50))
    assert p is not None
    assert p < 1e-4


@given(seeds, st.floats(-10, 10))
def test_bootstrap_contains_the_mean_and_moves_with_the_values(seed: int, by: float) -> None:
    values = np.random.default_rng(seed).normal(size=12)
    found, moved = (paired_bootstrap(values + shift, np.random.default_rng(0), 500) for shift in (0.0, by))
    assert found.low < found.value < found.high
    assert (moved.low - by, moved.high - by) == pytest.approx((found.low, found.high), abs=1e-9)


@given(seeds)
def test_mcnemar_counts_unequal_pairs_only(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ours, theirs = rng.random(40) < 0.8, rng.random(40) < 0.5
    agree = np.ones(25, bool)
    p = mcnemar_p(ours, theirs)
    assert 0 <= p <= 1
    assert mcnemar_p(np.append(ours, agree), np.append(theirs, agree)) == p
    assert mcnemar_p(ours, ours) == 1
