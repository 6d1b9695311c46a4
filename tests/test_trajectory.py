"""Laws of exported plans: time goes on, arms hold the grippers, nothing is too fast, both formats say the same."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from fairlead.core.errors import FairleadError
from fairlead.core.records import ActionOutcome, PlanOutcome, SearchTree, TrialOutcome
from fairlead.core.traces import Trace, TracedAction, TracedPlan
from fairlead.evaluation.shipped import benchmark_scenes
from fairlead.scenarios.arms import TOLERANCE
from fairlead.scenarios.registry import scenario
from fairlead.scenarios.trajectory import REST_S, Trajectory, planned, trajectory

NAMES = ["fetch_cable", "install_hose", "dual_arm"]
each = pytest.mark.parametrize("name", NAMES)


def drawn(name: str, number: int = 0, steps: int = 12) -> Trajectory:
    """Random actions, one after the other, from the start of a scene that comes with the package."""
    world = scenario(name)
    scene = world.scenes(benchmark_scenes(name)).scenes[number]
    rng, state, actions = np.random.default_rng(number), scene.state(world.layout), []
    for _ in range(steps):
        (action,) = world.sampler.propose(state[None], rng)
        state = state.copy()
        state[: world.layout.action_size] = action
        actions.append(action)
    return trajectory(world, scene, scene.state(world.layout), np.stack(actions), {"scene": scene.name})


def parts(name: str, found: Trajectory) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (row,), grippers (row, gripper, 3) and joints (row, arm, joint)."""
    count = len(scenario(name).layout.grippers)
    times, places, joints = found.rows[:, 0], found.rows[:, 2 : 2 + 3 * count], found.rows[:, 2 + 3 * count :]
    return times, places.reshape(len(times), count, 3), joints.reshape(len(times), count, -1)


def test_the_first_plan_is_exported_and_says_whether_it_ends_in_the_goal() -> None:
    world = scenario("dragging")
    scene = world.scenes(benchmark_scenes("dragging")).scenes[0]
    start, nothing = scene.state(world.layout), np.zeros((0, world.layout.state_size))
    tree = SearchTree(nothing, np.zeros(0, int), np.zeros(0))
    target = start[:3] + np.array([0.05, 0.0, 0.0])

    def attempt(index: int, outcome: PlanOutcome) -> TracedPlan:
        found = (nothing, np.zeros((0, 3))) if outcome is PlanOutcome.STUCK else (start[None], target[None])
        return TracedPlan(index, outcome, 0.0, 32, *found, np.ones(len(found[1])), tree)

    def exported(*outcomes: PlanOutcome) -> Trajectory:
        plans = tuple(attempt(*of) for of in enumerate(outcomes))
        recovery = TracedAction(0, True, target, ActionOutcome.TARGET, 1.0, 1.0, start, 0.3)
        trace = Trace({"scene": scene.name}, world.layout, start, 0.3, plans, (recovery,), TrialOutcome.BUDGET, {})
        return planned(world, scene, trace)

    for outcome in (PlanOutcome.PARTIAL, PlanOutcome.GOAL):
        found = exported(PlanOutcome.STUCK, outcome, PlanOutcome.GOAL)
        assert found.about["outcome"] == outcome.label
        assert (found.about["plan"], found.about["recovered"]) == (1, 1)
        assert found.rows[-1, 2:5] == pytest.approx(target, abs=1e-6)
    with pytest.raises(FairleadError, match="no plan to export"):
        exported(PlanOutcome.STUCK)


@each
def test_time_goes_on_from_the_start_of_the_scene(name: str) -> None:
    world, found = scenario(name), drawn(name)
    start = world.scenes(benchmark_scenes(name)).scenes[0].state(world.layout)
    times, places, _ = parts(name, found)
    assert times[0] == 0
    assert (np.diff(times) > 0).all()
    assert (np.diff(found.rows[:, 1]) >= 0).all()
    assert places[0] == pytest.approx(world.layout.grippers_of(start), abs=1e-6)


@each
@pytest.mark.parametrize("number", range(3))
def test_nothing_is_faster_or_farther_than_it_may_be(name: str, number: int) -> None:
    world, found = scenario(name), drawn(name, number)
    times, places, joints = parts(name, found)
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=-1) / np.diff(times)[:, None]
    assert speeds.max() <= world.gripper_speed * (1 + 1e-9)
    if world.arms is None:
        assert joints.size == 0
        return
    assert (np.abs(np.diff(joints, axis=0)) <= world.arms.speed_limits * (np.diff(times)[:, None, None] + 1e-9)).all()
    low, high = (limit[..., 0].T for limit in (world.arms.kinematics.low, world.arms.kinematics.high))
    assert ((joints >= low) & (joints <= high)).all()


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize("name", NAMES[1:])
def test_the_joints_hold_the_grippers(name: str, number: int) -> None:
    world, found = scenario(name), drawn(name, number)
    assert world.arms is not None
    _, places, joints = parts(name, found)
    tips = world.arms.kinematics.forward(np.ascontiguousarray(joints.T)).tips.T
    assert np.linalg.norm(tips - places, axis=-1).max() <= TOLERANCE + 1e-5
    assert len(found.columns) == found.rows.shape[1] == 2 + 6 + 14
    assert found.columns[8] == "left_1_rad"


@each
def test_the_grippers_rest_after_every_action(name: str) -> None:
    found = drawn(name)
    assert found.about["actions_done"] > 0
    for action in range(1, found.about["actions_done"] + 1):
        rows = found.rows[found.rows[:, 1] == action]
        assert (rows[-1, 2:] == rows[-2, 2:]).all()
        assert rows[-1, 0] - rows[-2, 0] == pytest.approx(REST_S)


def test_a_trajectory_ends_where_the_arms_are_stopped_and_says_so() -> None:
    world = scenario("dual_arm")
    scene = world.scenes(benchmark_scenes("dual_arm")).scenes[0]
    start = scene.state(world.layout)
    there = start[: world.layout.action_size]
    found = trajectory(world, scene, start, np.stack([there, there + np.tile([2.0, 0.0, 0.0], 2), there]), {})
    assert (found.about["actions"], found.about["actions_done"], found.about["ends"]) == (3, 1, "joint_limit")
    assert found.rows[:, 1].max() <= 2


@each
def test_both_formats_say_the_same(name: str, tmp_path: Path) -> None:
    found = drawn(name)
    for suffix in ("csv", "json"):
        found.write(tmp_path / f"plan.{suffix}")
    head, *rows = csv.reader((tmp_path / "plan.csv").open())
    told = json.loads((tmp_path / "plan.json").read_text())
    assert head == told["columns"]
    assert np.array(rows, float).tolist() == told["rows"] == found.rows.tolist()
    assert {name.rpartition("_")[2] for name in head[2:]} == {*told["units"][2:]}
    assert told["scene"] == found.about["scene"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plan.csv", "plan.json"]


def test_what_cannot_be_written_leaves_the_old_file_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found, path = drawn("fetch_cable"), tmp_path / "plan.csv"
    with pytest.raises(FairleadError, match=r"plan\.txt: .*\.csv or \.json"):
        found.write(tmp_path / "plan.txt")
    path.write_text("old")
    monkeypatch.setattr("os.replace", lambda *_: (_ for _ in ()).throw(OSError("full")))
    with pytest.raises(OSError, match="full"):
        found.write(path)
    assert path.read_text() == "old"
