"""The collection benchmark measures what it says."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks import collection
from benchmarks.collection import Bare, collect_vs_raw

from fairlead.core.streams import stream
from fairlead.scenarios.registry import scenario

STARTS = np.array([scenario("dragging").random_start(stream(0, "start", i)) for i in range(2)])


def test_bare_steps_are_those_of_collection(monkeypatch: pytest.MonkeyPatch) -> None:
    """Made again from the same state with the same control, a step ends in the same state, bit for bit."""
    monkeypatch.setattr(collection, "WINDOW", 1)
    monkeypatch.setattr(collection, "EVERY", 7)
    world = scenario("dragging").simulate([(), ()], STARTS)
    bare, step, same = Bare(world.simulation, 1), world.simulation.step, []

    def stepping(ids: np.ndarray, count: int = 1) -> None:
        bare.before_step()
        step(ids, count)
        same.append(np.array_equal(bare._ours[0], world.simulation.qpos))

    world.simulation.step = stepping
    world.execute(np.c_[STARTS[:, :2] + 0.05, STARTS[:, 2]])
    assert all(same[::7])
    assert not any(same[1::7])


def test_the_ratio_is_of_the_rates_it_is_given_with() -> None:
    rates = collect_vs_raw(scenario("dragging"), lanes=2, steps=3, threads=1, trajectories=2)
    assert min(rates.ours, rates.reference) > 0
    assert rates.ratio == pytest.approx(rates.ours / rates.reference)
