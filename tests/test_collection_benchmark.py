"""The collection benchmark measures what it says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from benchmarks.collection import _first_shard, collect_vs_raw, record

from fairlead.data.collect import CollectConfig
from fairlead.scenarios.registry import scenario


def test_bare_steps_follow_the_collection_that_they_are_compared_with(tmp_path: Path) -> None:
    world, config = scenario("dragging"), CollectConfig(2, trajectories=4, lanes=2, steps=3)
    _first_shard(world, config, 1, tmp_path / "begun")
    recorded = record(world, config, 1, tmp_path / "begun")
    after = recorded.simulation.qpos.copy()
    assert recorded.bare_rate() > 0
    # Bare steps do not hold the grippers that have arrived, but they drive the same motion.
    assert np.abs(recorded.simulation.qpos[:, :2] - after[:, :2]).max() < 0.1


def test_the_ratio_is_of_the_rates_it_is_given_with() -> None:
    rates = collect_vs_raw(scenario("dragging"), lanes=2, steps=2, threads=1, rounds=1)
    assert min(rates.ours, rates.reference) > 0
    assert rates.ratio == pytest.approx(rates.ours / rates.reference)
