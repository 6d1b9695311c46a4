"""The planning benchmarks measure what they say, on the toy."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from toy import BAR, arena, problem, straight, tail_goal

FILE = Path(__file__).parent.parent / "benchmarks" / "planning.py"
START = straight(-0.4, 0.0)


@pytest.fixture(scope="module")
def benchmarks():
    spec = importlib.util.spec_from_file_location("planning_benchmarks", FILE)
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_planner_is_measured_beside_its_networks_and_beside_ompl(benchmarks):
    task = problem(arena(BAR), tail_goal(0.5, 0.1))
    for rates in (
        benchmarks.planner_vs_networks(task, START, extensions=1000),
        benchmarks.planner_vs_ompl(task, START, extensions=1000, ompl_extensions=50),
    ):
        assert rates.ours > 0
        assert rates.reference > 0
        assert rates.ratio > 0


def test_a_growing_problem_grows_and_never_arrives(benchmarks):
    task = benchmarks.growing(problem(arena(BAR), tail_goal(0.5, 0.1)))
    rate, plan = benchmarks.timed_plan(benchmarks.BatchedRRT(), task, START, 3000, 0)
    assert rate > 0
    assert (plan.extensions, plan.outcome.label) == (3000, "partial")
    assert plan.nodes > 1500
    assert np.isfinite(plan.tree.states).all()


def test_the_rate_is_given_for_every_size(benchmarks):
    rates = benchmarks.rate_by_tree_size(problem(arena(BAR), tail_goal(0.5, 0.1)), START, (1000, 3000))
    assert set(rates) == {1000, 3000}
    assert all(np.isfinite(rate) for rate in rates.values())
