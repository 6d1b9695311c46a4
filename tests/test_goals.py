"""Laws of goals, one suite for every kind: errors are distances, samples lead there, files keep what they hold."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

import synthetic
from fairlead.core.budget import Budget, Meter
from fairlead.core.contracts import check_goal
from fairlead.core.errors import FileFormatError
from fairlead.core.layout import StateLayout
from fairlead.core.marks import followed, marks
from fairlead.core.reading import Reader
from fairlead.core.records import PlanOutcome
from fairlead.core.streams import stream
from fairlead.evaluation.shipped import benchmark_scenes
from fairlead.geometry.goals import KINDS, SceneGoal, point_goal, read_goal
from fairlead.planning.ompl import OmplRRT
from fairlead.planning.rrt import BatchedRRT
from fairlead.report.drawing import draw_goal, view_of
from fairlead.report.stage import TopView
from fairlead.scenarios.dragging import Dragging
from fairlead.scenarios.dual_arm import DualArm
from fairlead.scenarios.registry import scenario
from fairlead.scenarios.render import SceneRenderer
from fairlead.scenarios.scene_files import read_scenes, write_scenes
from toy import LAYOUT as TOY
from toy import arena, problem, straight

LAYOUT = StateLayout(("left", "right"), 5)
YAW = [0.0, 0.0, float(np.sin(0.3)), float(np.cos(0.3))]
BOX = {"size": [0.5, 0.3, 0.4], "position": [0.2, -0.1, 0.3], "quaternion_xyzw": YAW}
TAIL = {"target": "tail", "position": [0.3, -0.2, 0.1], "radius": 0.2}
AGAIN = {"target": "tail", "position": [0, 0, 0]}
ENDS = {
    "kind": "points",
    "places": [{"target": "head", "position": [0.3, 0.1, 0.2]}, {"target": 0, "position": [0.0, 0.4, 0.2]}],
    "radius": 0.15,
}
HELD = {
    "kind": "points",
    "places": [{"target": "left", "position": [0.2, 0.1, 0.2]}, {"target": "right", "position": [0.0, -0.4, 0.1]}],
    "radius": 0.1,
}
INSIDE, OUTSIDE = {"kind": "inside", "box": BOX}, {"kind": "outside", "box": BOX}
WRITTEN: dict[str, dict[str, Any]] = {
    "tail": TAIL,
    "midpoint": {"kind": "point", "target": "midpoint", "position": [0.0, 0.1, 0.2], "radius": 0.05},
    "ends": ENDS,
    "grippers": HELD,
    "inside": INSIDE,
    "outside": OUTSIDE,
    "all": {"kind": "all", "goals": [OUTSIDE, TAIL]},
    "any": {"kind": "any", "goals": [INSIDE, ENDS, {"kind": "all", "goals": [HELD]}]},
}
each_goal = pytest.mark.parametrize("written", WRITTEN.values(), ids=WRITTEN)
seeds = st.integers(0, 2**32)
few = settings(max_examples=10)


def read(written: Any, layout: StateLayout = LAYOUT) -> SceneGoal:
    return read_goal(layout, Reader(Path("scenes.json"), written, "scenes[3].goal"))


def ropes(seed: int, count: int = 12) -> np.ndarray:
    """Smooth and crumpled ropes, near the goals and far from them."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(0, rng.uniform(0.01, 0.3, (count, 1, 1)), (count, 7, 3))
    points = rng.normal(0, 0.3, (count, 1, 3)) + np.cumsum(steps, axis=1)
    return LAYOUT.join(points[:, [0, -1]], points[:, 1:-1])


def there(written: dict[str, Any], state: np.ndarray) -> bool:
    """The same in other words, one state and one point at a time."""
    kind, rope = written.get("kind", "point"), LAYOUT.points_of(state)
    if kind in ("all", "any"):
        return {"all": all, "any": any}[kind](there(part, state) for part in written["goals"])
    if kind in ("point", "points"):
        named = {"tail": rope[0], 0: rope[0], "midpoint": rope[2], "head": rope[4],
                 "left": LAYOUT.grippers_of(state)[0], "right": LAYOUT.grippers_of(state)[1]}  # fmt: skip
        places = written.get("places", [written])
        return all(np.linalg.norm(named[p["target"]] - p["position"]) <= written["radius"] for p in places)
    turn = np.array([[np.cos(0.6), np.sin(0.6), 0], [-np.sin(0.6), np.cos(0.6), 0], [0, 0, 1]])
    beyond = [np.abs(turn @ (p - BOX["position"])) - np.array(BOX["size"]) / 2 for p in rope]
    return all((b <= 0).all() for b in beyond) if kind == "inside" else all((b >= 0).any() for b in beyond)


@each_goal
@few
@given(seed=seeds)
def test_a_goal_is_reached_where_its_error_is_within_its_tolerance(written: dict[str, Any], seed: int) -> None:
    goal, states = read(written), ropes(seed)
    states = np.concatenate([states, goal.sample(states, np.random.default_rng(seed))])
    np.testing.assert_array_equal(goal.reached(states), [there(written, state) for state in states])
    np.testing.assert_array_equal(goal.reached(states), goal.error(states) <= goal.tolerance)


@each_goal
@few
@given(seed=seeds)
def test_the_error_is_a_distance(written: dict[str, Any], seed: int) -> None:
    """No shift of the state changes the error by more than its length."""
    goal, states = read(written), ropes(seed)
    shift = np.random.default_rng(seed).normal(0, 0.2, (len(states), 3))
    change = goal.error(states + np.tile(shift, LAYOUT.state_size // 3)) - goal.error(states)
    assert (np.abs(change) <= np.linalg.norm(shift, axis=1) + 1e-12).all()


@each_goal
@few
@given(seed=seeds)
def test_samples_are_in_the_goal_or_no_farther(written: dict[str, Any], seed: int) -> None:
    goal, states = read(written), ropes(seed)
    check_goal(goal, states)
    reached = goal.reached(goal.sample(states, np.random.default_rng(seed)))
    assert reached.all() or written.get("kind") in ("all", "any")


@given(seed=seeds, target=st.sampled_from(["tail", "left", 3]))
def test_one_place_moves_a_state_as_a_whole(seed: int, target: str | int) -> None:
    states = ropes(seed)
    sampled = point_goal(LAYOUT, target, (0.3, -0.2, 0.0), 0.1).sample(states, np.random.default_rng(0))
    shift = (sampled - states).reshape(len(states), -1, 3)
    np.testing.assert_allclose(shift, np.broadcast_to(shift[:, :1], shift.shape), atol=1e-12)


@each_goal
@pytest.mark.parametrize("world", [Dragging(), DualArm()], ids=lambda world: world.name)
def test_goals_survive_the_round_trip_through_a_scene_file(written: dict[str, Any], world: Any, tmp_path: Path) -> None:
    text = json.dumps(written).replace('"left"', f'"{world.layout.grippers[0]}"')
    if len(world.layout.grippers) == 1:
        text = text.replace('"right"', '"tail"')
    goal = read(json.loads(text.replace('"right"', f'"{world.layout.grippers[-1]}"')), world.layout)
    shipped = world.scenes(benchmark_scenes(world.name)).scenes[0]
    scene = type(shipped)(shipped.name, shipped.obstacles, shipped.grippers, shipped.rope, goal)
    write_scenes(tmp_path / "s.json", world.name, [scene], "a test")
    assert read_scenes(tmp_path / "s.json", world.name, world.layout).scenes == (scene,)


@pytest.mark.parametrize("file", sorted(benchmark_scenes("dragging").parent.glob("*.json")), ids=lambda f: f.stem)
def test_every_scene_file_that_comes_with_the_package_is_read_and_written_as_it_is(file: Path) -> None:
    content = json.loads(file.read_text())
    scenes = read_scenes(file, content["scenario"], scenario(content["scenario"]).layout)
    assert json.loads(json.dumps([scene.written() for scene in scenes.scenes])) == content["scenes"]


@pytest.mark.parametrize(
    ("written", "says"),
    [
        ({"kind": "insid", "box": BOX}, r"goal.kind: unknown goal 'insid' .did you mean 'inside'..; allowed: all"),
        ({"kind": 3}, "goal.kind: a string is needed, got int"),
        ({**TAIL, "target": "nose"}, "goal.target: unknown point 'nose'; allowed: 0 to 4, head, left, midpoint"),
        ({**TAIL, "target": 5}, "goal.target: unknown point '5'"),
        ({**TAIL, "target": [1]}, "goal.target: the name or the number of a point is needed, got list"),
        ({**TAIL, "radius": 0}, "goal.radius: a positive number of metres is needed, got 0"),
        ({"kind": "points", "radius": 1}, "goal.places: missing; found: kind, radius"),
        ({"kind": "points", "places": [], "radius": 1}, "goal.places: at least one is needed"),
        ({**ENDS, "places": [*ENDS["places"], AGAIN]}, r"goal.places\[2\].target: 'tail' has a place already"),
        ({"kind": "inside", "box": {**BOX, "size": [1, -1, 1]}}, "goal.box.size: every side must be positive"),
        ({"kind": "all", "goals": []}, "goal.goals: at least one is needed"),
        ({"kind": "any", "goals": [TAIL, 3]}, r"goal.goals\[1\]: an object is needed, got int"),
    ],
)  # fmt: skip
def test_mistakes_are_named(written: Any, says: str) -> None:
    with pytest.raises(FileFormatError, match="scenes.json: .*" + says) as error:
        read(written)
    assert "\n" not in str(error.value)


TOY_BOX = {"size": [0.7, 0.8, 0.2], "position": [0.3, 0.4, 0.02], "quaternion_xyzw": [0, 0, 0, 1]}
AROUND = {"size": [0.8, 0.5, 0.2], "position": [-0.6, 0.0, 0.02], "quaternion_xyzw": [0, 0, 0, 1]}
REACHABLE: dict[str, Any] = {
    "point": {"target": "midpoint", "position": [0.3, 0.1, 0.02], "radius": 0.1},
    "points": {"kind": "points", "radius": 0.2, "places": [
        {"target": "tail", "position": [0.4, 0.4, 0.02]}, {"target": "gripper", "position": [0.6, 0.2, 0.02]}]},
    "inside": {"kind": "inside", "box": TOY_BOX},
    "outside": {"kind": "outside", "box": AROUND},
    "all": {"kind": "all", "goals": [
        {"kind": "outside", "box": AROUND}, {"target": "head", "position": [0.4, -0.3, 0.02], "radius": 0.2}]},
    "any": {"kind": "any", "goals": [
        {"target": "tail", "position": [9.0, 9.0, 0.02], "radius": 0.05}, {"kind": "inside", "box": TOY_BOX}]},
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("planner", [BatchedRRT(), OmplRRT()], ids=["rrt", "ompl"])
def test_every_planner_reaches_every_kind_of_goal(planner: Any, kind: str) -> None:
    goal, start = read(REACHABLE[kind], TOY), straight(-0.6, 0.0)
    assert not goal.reached(start)
    plan = planner.plan(problem(arena(), goal), start, Meter(Budget(extensions=20_000), lambda: 0.0), stream(4))
    assert plan.outcome is PlanOutcome.GOAL
    assert goal.reached(plan.states[-1])


@each_goal
def test_every_kind_is_drawn(written: dict[str, Any]) -> None:
    scene = {**synthetic.scene("s", np.random.default_rng(0)), "goal": written}
    bare = {**scene, "goal": {**TAIL, "position": [9.0, 9.0, 0.0]}}
    layout = StateLayout(("left", "right"), 10)
    assert all(0 <= point < 10 for point in followed(written, layout))
    axes = Figure().add_subplot()
    draw_goal(axes, written)
    assert len(axes.patches) == len(marks(written))
    centre, half = view_of(scene)
    assert (np.abs(np.array([mark.get("position") for mark in marks(written)])[:, :2] - centre) <= half).all()
    stage = TopView(scene, layout, (0,))
    drawn, empty = (np.asarray(stage._arena(shown)) for shown in (scene, bare))
    assert (drawn != empty).any()
    with_goal, without = (
        SceneRenderer(Dragging().backdrop(), Dragging.layout, 0.02, (), goal, 64, 64) for goal in (marks(written), ())
    )
    with with_goal, without:
        state = np.zeros(Dragging.layout.state_size)
        assert (with_goal.frame(state) != without.frame(state)).any()
