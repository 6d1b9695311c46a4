"""The threshold on the ensemble's spread: no other has a better balanced accuracy."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from fairlead.learning.metrics import best_threshold


@given(st.integers(0, 2**32 - 1))
def test_best_threshold_beats_every_other(seed: int) -> None:
    rng = np.random.default_rng(seed)
    spread = rng.gamma(2.0, 0.01, 60)
    reliable = rng.random(60) < np.exp(-40 * spread)
    reliable[:2] = [True, False]

    def balanced(threshold: float) -> float:
        return float((spread[reliable] < threshold).mean() + (spread[~reliable] >= threshold).mean())

    best = balanced(best_threshold(spread, reliable))
    assert all(best >= balanced(threshold) - 1e-12 for threshold in np.linspace(0, 0.2, 101))


def test_of_equally_good_thresholds_the_one_that_trusts_most_is_taken() -> None:
    assert best_threshold(np.array([1.0, 2.0, 3.0, 4.0]), np.array([False, False, True, True])) > 4
    assert best_threshold(np.zeros(3), np.array([True, False, True])) > 0
