"""Laws of the dual-arm world: known answers of its physics, and what every caller relies on."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest

from fairlead.core.contracts import check_world
from fairlead.core.errors import FairleadError
from fairlead.core.records import ActionOutcome
from fairlead.core.streams import stream
from fairlead.data.collect import CollectConfig, collect
from fairlead.data.verify import verify
from fairlead.geometry.shapes import Box, Obstacle, box_distance
from fairlead.scenarios.dual_arm import OBSTACLES, DualArm
from fairlead.scenarios.dual_arm_world import LAYOUT, TABLE, DualArmWorld, Grippers, build_spec
from fairlead.scenarios.generate import generate
from fairlead.scenarios.hanging_rope import HangingRope
from fairlead.scenarios.obstacles import box_sizes

ROPE, MOTION = HangingRope(), Grippers()
DUAL = DualArm()
OUTCOMES = tuple(ActionOutcome)
BAR = Obstacle("bar", (Box((0.6, 0.02, 0.02), (0.8, 0.0, 0.85)),))
"""A horizontal bar along x, 0.2 m above the table."""


def _held(left: tuple[float, ...], right: tuple[float, ...]) -> np.ndarray:
    grippers = np.array([left, right])
    return LAYOUT.join(grippers, ROPE.hanging(grippers))


def _world(obstacles, states: np.ndarray, arms: bool = False) -> DualArmWorld:
    return DualArmWorld(obstacles, states, 1, ROPE, MOTION, DUAL.arms if arms else None)


@cache
def _scenes() -> tuple[list[tuple[Obstacle, ...]], np.ndarray]:
    return DUAL.rearrange(np.empty((24, 0)), [stream(1, "scene", i) for i in range(24)])


def _penetration(world: DualArmWorld, copy: int, but: Sequence[int] = ()) -> float:
    """How deep [m] the deepest contact of a copy is, but for those of some geoms."""
    data = world.simulation.batch.get_data(copy)
    mujoco.mj_forward(world.simulation.model, data)
    counts = ~np.isin(data.contact.geom, but).any(axis=1)
    return float(-data.contact.dist[counts].min(initial=0.0))


def _wait(world: DualArmWorld, seconds: float) -> None:
    """Let every copy go on for so long with its grippers where they are."""
    states = world.observe()
    world.send(np.arange(len(states)), states[:, : LAYOUT.action_size])
    for _ in range(round(seconds / world._tick_s)):
        world._tick(world._active)


def _check_length(states: np.ndarray) -> None:
    """Links keep their length: centres of neighbours are no farther apart, and ends are at the grippers."""
    points, grippers = LAYOUT.points_of(states), LAYOUT.grippers_of(states)
    ends = np.linalg.norm(points[:, [0, -1]] - grippers, axis=-1)
    assert np.linalg.norm(np.diff(points, axis=1), axis=-1).max() < ROPE.link_length + 1e-6
    assert np.abs(ends - ROPE.link_length / 2).max() < 1.1 * MOTION.stretch


def test_hanging_rope_is_a_catenary() -> None:
    """In a chain of equal rods at rest, the slope of the links grows by m g / H from link to link."""
    world = _world(None, _held((0.7, 0.3, 1.2), (0.8, -0.2, 1.1))[None])
    _wait(world, 1.0)
    state = world.observe()
    u = ROPE.directions(LAYOUT.points_of(state))[0]
    growth = np.diff(u[:, 2] / np.linalg.norm(u[:, :2], axis=1))
    assert growth.mean() > 0.05
    np.testing.assert_allclose(growth, growth.mean(), rtol=0.02)


def test_a_start_hangs_as_the_simulator_lets_it_hang() -> None:
    """The continuous catenary that starts are drawn from is near the chain's own."""
    rng = stream(2, "starts")
    states = np.array([DUAL.random_start(rng) for _ in range(8)])
    assert _world(None, states).residual.max() < 0.002


def test_a_released_rope_falls_freely() -> None:
    model = build_spec(None, ROPE).compile()
    data = mujoco.MjData(model)
    data.eq_active[:] = 0
    mujoco.mj_forward(model, data)
    start = np.array([data.site(f"point{i}").xpos for i in range(ROPE.links)])
    mujoco.mj_step(model, data, 50)
    mujoco.mj_kinematics(model, data)
    fallen = start - np.array([data.site(f"point{i}").xpos for i in range(ROPE.links)])
    expected = 9.81 * data.time * (data.time + model.opt.timestep) / 2
    np.testing.assert_allclose(fallen, np.tile([0.0, 0.0, expected], (ROPE.links, 1)), atol=1e-6)


@pytest.mark.parametrize("degrees", [44.0, 55.0])
def test_on_a_slope_a_released_rope_holds_or_slides_as_its_friction_tells(degrees: float) -> None:
    """It lies straight on the table, and gravity turns: it slides with g (sin - mu cos) where that is positive."""
    model, slope = build_spec((), ROPE).compile(), np.radians(degrees)
    data = mujoco.MjData(model)
    data.eq_active[:] = 0
    data.qpos[:3] = [0.8, 0.0, TABLE.position[2] + TABLE.size[2] / 2 + ROPE.radius]
    data.qpos[3:7] = [np.sqrt(0.5), 0, 0, np.sqrt(0.5)]
    mujoco.mj_step(model, data, 100)
    model.opt.gravity = 9.81 * np.array([0, np.sin(slope), -np.cos(slope)])
    mujoco.mj_step(model, data, 25)
    before = data.qvel[1]
    mujoco.mj_step(model, data, 50)
    slides = max(0.0, 9.81 * (np.sin(slope) - ROPE.friction[0] * np.cos(slope)))
    np.testing.assert_allclose((data.qvel[1] - before) / (50 * model.opt.timestep), slides, rtol=0.03, atol=1e-3)


def test_joint_positions_lay_the_rope_along_its_own_points() -> None:
    obstacles, states = _scenes()
    world = _world(obstacles, states)
    world.execute(DUAL.sampler.propose(world.observe(), stream(3, "laid")))
    before = world.observe()
    qpos = ROPE.joint_positions(LAYOUT.grippers_of(before), LAYOUT.points_of(before))
    world.simulation.qpos[:] = qpos
    gap = np.linalg.norm(LAYOUT.points_of(world.observe() - before), axis=-1)
    assert np.median(gap.max(axis=1)) < 1e-8
    assert gap.max() < 0.002


@pytest.mark.parametrize("roll", [0.0, 0.8, 1.6, 2.4])
def test_a_sharp_fold_can_be_laid_at_any_roll(roll: float) -> None:
    """A bend of 140 degrees beside the middle link, in planes all around it."""
    across = np.array([0.0, np.cos(roll), np.sin(roll)])
    u = np.tile([1.0, 0.0, 0.0], (ROPE.links, 1))
    u[ROPE.middle + 1 :] = np.cos(np.radians(140)) * u[0] + np.sin(np.radians(140)) * across
    points = ROPE.centre_weights @ u + [0.0, 0.0, 3.0]
    ends = np.stack([[0.0, 0.0, 3.0], points[-1] + u[-1] * ROPE.link_length / 2])
    world = _world(None, _held((0.7, 0.3, 1.2), (0.8, -0.2, 1.1))[None])
    world.simulation.qpos[:] = ROPE.joint_positions(ends[None], points[None])
    np.testing.assert_allclose(LAYOUT.points_of(world.observe())[0], points, atol=0.004)


def test_pulled_down_onto_a_bar_the_rope_neither_sinks_in_nor_tunnels_and_holds() -> None:
    """The grippers pass below the bar on both sides; the rope hangs over it and stays on it when pulled sideways."""
    state = _held((0.8, 0.25, 1.25), (0.8, -0.25, 1.25))
    world, worst = _world([[BAR]], state[None]), 0.0
    field = DUAL.environment([BAR])
    moves = [[0, 0, -0.1]] * 4 + [[0, 0.05, -0.05], [0, -0.1, 0], [0.05, 0.1, 0]]
    for move in moves:
        action = world.observe()[:, : LAYOUT.action_size] + np.tile(move, 2)
        world.send(np.array([0]), action)
        while True:
            at_rest = world._tick(world._active)
            worst = max(worst, _penetration(world, 0))
            if at_rest[0]:
                break
        world.receive()
        points = LAYOUT.points_of(world.observe())[0]
        assert field.signed_distance(points).min() > 0, "a point is inside the bar"
        assert points[np.abs(points[:, 1]).argmin(), 2] > 0.86, "the rope has passed through the bar"
    assert world.observe()[0, 2] < 0.8
    assert worst < 0.003, f"penetration of {1000 * worst:.2f} mm"


def test_pulls_of_full_length_into_whatever_is_there_neither_tunnel_nor_sink() -> None:
    """Each gripper goes its own way, half of them down; checked while they move, not after settling.

    The two links that grippers hold go where the arms go, up to a finger's clearance from an obstacle.
    """
    obstacles, states = (rows[:8] for rows in _scenes())
    world, rng, worst = _world(obstacles, states, arms=True), stream(8, "pulls"), 0.0
    fields = [DUAL.environment(o) for o in obstacles]
    held = [world.simulation.model.geom(f"link{i}").id for i in (0, ROPE.links - 1)]
    for _ in range(3):
        ways = rng.normal(size=(len(states), 2, 3))
        ways[::2, :, 2] = -np.abs(ways[::2, :, 2])
        pulls = DUAL.sampler.reach * ways / np.linalg.norm(ways, axis=-1, keepdims=True)
        world.send(np.arange(len(states)), DUAL.sampler.targets(world.observe(), pulls))
        for tick in itertools.count():
            if not len(world._active):
                break
            world._active = world._active[~world._tick(world._active)]
            for i in range(len(states) if tick % 8 == 0 else 0):
                points = LAYOUT.points_of(world.observe()[i])
                assert fields[i].signed_distance(points).min() > 0, "a point is inside an obstacle"
                worst = max(worst, _penetration(world, i, held))
    assert not world.simulation.diverged(np.arange(len(states), dtype=np.int32)).any()
    assert 0 < worst < 0.003, f"penetration of {1000 * worst:.2f} mm"


def test_a_rope_caught_on_a_hook_holds() -> None:
    """Pulled up against a plate from below, the rope stretches instead of passing, and the motion is undone."""
    state = _held((0.8, 0.30, 1.0), (0.8, -0.30, 1.0))
    hook = Obstacle("hook", (Box((0.3, 0.04, 0.02), (0.8, 0.0, 1.05)),))
    world = _world([[hook]], state[None])
    ended = []
    for _ in range(6):
        executed = world.execute(world.observe()[:, : LAYOUT.action_size] + np.tile([0, 0, 0.1], 2))
        ended.append(OUTCOMES[executed.outcomes[0]])
    points = LAYOUT.points_of(world.observe())[0]
    assert ActionOutcome.STRETCH in ended
    assert points[np.abs(points[:, 1]).argmin(), 2] < 1.04
    assert _penetration(world, 0) < 0.003


@pytest.mark.parametrize(("number", "beside", "height"), [(5, -0.09, 0.94), (6, -0.055, 1.02)])
@pytest.mark.parametrize(
    ("moves", "held"),
    [
        ([[0, 0, 0.1]] * 5, True),
        ([[0.1, 0, 0], *[[0, 0, 0.1]] * 5], True),
        ([*[[-0.1, 0, 0]] * 2, *[[0, 0, 0.1]] * 4], False),
    ],
    ids=["up", "to the post and up", "out from below and up"],
)
def test_a_hook_of_the_scenario_lets_the_rope_go_where_it_is_open(
    number: int, beside: float, height: float, moves: list[list[float]], held: bool
) -> None:
    """A rope below the hook's plate, beside its post."""
    hook = OBSTACLES[number].moved((0.8, 0.0, 0.0), 0.0)
    world = _world([[hook]], _held((0.8 + beside, 0.30, height), (0.8 + beside, -0.30, height))[None])
    plate, field, ended = hook.boxes[1], DUAL.environment([hook]), []
    for move in moves:
        executed = world.execute(world.observe()[:, : LAYOUT.action_size] + np.tile(move, 2))
        ended.append(OUTCOMES[executed.outcomes[0]])
        points = LAYOUT.points_of(executed.states)[0]
        assert field.signed_distance(points).min() > 0, "a point is inside the hook"
        assert _penetration(world, 0) < 0.003
    middle = points[np.abs(points[:, 1]).argmin(), 2]
    assert (middle < plate.position[2]) == held
    assert (ActionOutcome.STRETCH in ended) == held


def test_a_rope_does_not_pass_through_itself() -> None:
    """The lower end is drawn straight across the strand of the higher one, and takes it along."""
    world = _world(None, _held((0.8, 0.08, 0.95), (0.8, -0.08, 1.2))[None])
    near = []
    for _ in range(3):
        world.send(np.array([0]), world.observe()[:, : LAYOUT.action_size] + [0, -0.1, 0, 0, 0, 0])
        while not world._tick(world._active)[0]:
            points = LAYOUT.points_of(world.observe())[0]
            apart = np.linalg.norm(points[:, None] - points[None], axis=-1)
            near.append(apart[np.triu_indices(len(points), 4)].min())
        world.receive()
    assert min(near) < 2.5 * ROPE.radius, "the strands never came near each other"
    assert min(near) > 2 * ROPE.radius - 0.003


def test_overstretching_is_undone_and_never_diverges() -> None:
    rng = stream(4, "stretch")
    states = np.array([DUAL.random_start(rng) for _ in range(16)])
    world = _world(None, states)
    grippers = LAYOUT.grippers_of(states)
    apart = 0.1 * (grippers - grippers[:, ::-1]) / np.linalg.norm(grippers[:, :1] - grippers[:, 1:], axis=-1)[..., None]
    for _ in range(6):
        executed = world.execute(world.observe()[:, : LAYOUT.action_size] + apart.reshape(16, -1))
        span = np.linalg.norm(np.subtract(*np.moveaxis(LAYOUT.grippers_of(executed.states), 1, 0)), axis=-1)
        assert not executed.diverged.any()
        assert (span < ROPE.length + 2 * MOTION.stretch).all()
        _check_length(executed.states)
    assert (executed.outcomes == OUTCOMES.index(ActionOutcome.STRETCH)).all()


def test_state_at_rest_does_not_drift() -> None:
    """Whole-rope distance after 3 s, 90th percentile: 10 mm for draped ropes, 6 mm for free ones."""
    obstacles, states = _scenes()
    world = _world(obstacles, states)
    for _ in range(2):
        world.execute(DUAL.sampler.propose(world.observe(), stream(5, "drift")))
    before = world.observe()
    fields = [DUAL.environment(o) for o in obstacles]
    near = [f.signed_distance(LAYOUT.points_of(s)).min() for f, s in zip(fields, before, strict=True)]
    draped = np.array(near) < 1.2 * ROPE.radius
    _wait(world, 3.0)
    moved = np.linalg.norm(LAYOUT.points_of(world.observe() - before).reshape(len(before), -1), axis=1)
    assert draped.any()
    assert np.percentile(moved[draped], 90) < 0.010
    assert np.percentile(moved[~draped], 90) < 0.006


def test_random_actions_keep_length_and_do_not_diverge() -> None:
    obstacles, states = _scenes()
    world, rng = _world(obstacles, states, arms=True), stream(6, "actions")
    for _ in range(4):
        executed = world.execute(DUAL.sampler.propose(world.observe(), rng))
        assert not executed.diverged.any()
        _check_length(executed.states)
        for boxes, state in zip(obstacles, executed.states, strict=True):
            assert box_distance([TABLE, *(b for o in boxes for b in o.boxes)], LAYOUT.points_of(state)).min() > 0.006


def test_the_free_rope_has_no_preferred_direction() -> None:
    """Turned starts and actions lead to turned outcomes."""
    rng = stream(7, "turn")
    states = np.array([DUAL.random_start(rng) for _ in range(8)])
    actions = DUAL.unconstrained_sampler.propose(states, rng)
    c, s = np.cos(0.6), np.sin(0.6)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def turned(vectors: np.ndarray) -> np.ndarray:
        return (vectors.reshape(len(vectors), -1, 3) @ turn.T).reshape(len(vectors), -1)

    straight = _world(None, states).execute(actions).states
    other = _world(None, turned(states)).execute(turned(actions)).states
    assert np.abs(turned(straight) - other).max() < 0.0005


def test_the_draped_rope_has_no_preferred_direction() -> None:
    """On the table friction is a cone, not a pyramid along the axes; the bar turns with the rope."""
    state = _held((0.72, 0.22, 0.80), (0.88, -0.22, 0.80))
    move = np.array([[0.06, 0.03, 0.0, 0.06, 0.03, 0.0]])
    ended = []
    for yaw in (0.0, 0.7):
        turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        centre = np.array(TABLE.position) * [1, 1, 0]
        turned = ((state.reshape(-1, 3) - centre) @ turn.T + centre).reshape(1, -1)
        world = _world([()], turned)
        after = world.execute(world.observe()[:, : LAYOUT.action_size] + np.tile(move[0, :3] @ turn.T, 2)).states
        ended.append((after.reshape(-1, 3) - centre) @ turn)
    assert (ended[0][2:, 2] < TABLE.position[2] + TABLE.size[2] / 2 + 0.012).sum() > 5
    assert np.abs(ended[0] - ended[1]).max() < 0.001


def test_an_observed_state_can_be_simulated_again() -> None:
    """Quasi-static: the 81 numbers say enough to repeat an action."""
    obstacles, states = _scenes()
    world, rng = _world(obstacles, states), stream(8, "again")
    world.execute(DUAL.sampler.propose(world.observe(), rng))
    before = world.observe()
    actions = DUAL.sampler.propose(before, rng)
    first, second = world.execute(actions).states, _world(obstacles, before).execute(actions).states
    assert np.median(np.abs(first - second).max(axis=1)) < 0.001


def test_rows_and_threads_do_not_influence_each_other() -> None:
    obstacles, states = _scenes()
    actions = DUAL.sampler.propose(states, stream(9, "rows"))
    together = DUAL.simulate(obstacles, states, threads=2).execute(actions).states
    alone = DUAL.simulate(obstacles[3:4], states[3:4]).execute(actions[3:4]).states
    np.testing.assert_array_equal(together[3:4], alone)


def test_the_world_keeps_its_contract() -> None:
    obstacles, states = _scenes()
    check_world(DUAL.simulate(obstacles[:3], states[:3]), DUAL.sampler.propose(states[:3], stream(10, "contract")))


@pytest.mark.parametrize("speed", [np.nan, 1e4])
def test_divergence_is_found_and_never_observed(speed: float) -> None:
    obstacles, states = _scenes()
    world = _world(obstacles[:3], states[:3])
    before = world.observe()
    tick = world._tick

    def break_one(ids: np.ndarray) -> np.ndarray:
        if 1 in ids:
            world.simulation.qvel[1] = speed
        return tick(ids)

    world._tick = break_one
    executed = world.execute(DUAL.sampler.propose(before, stream(11, "broken")))
    assert executed.diverged.tolist() == [False, True, False]
    np.testing.assert_allclose(executed.states[1], before[1], atol=1e-9)
    world._tick = tick
    again = world.execute(DUAL.sampler.propose(before, stream(11, "mended")))
    assert not again.diverged.any(), "a copy that diverged once goes on from where it was put back"


def test_a_copy_that_restarts_alone_is_as_in_a_new_world() -> None:
    obstacles, states = _scenes()
    world = DUAL.simulate(obstacles[:3], states[:3])
    actions = DUAL.sampler.propose(world.observe(), stream(13, "restart"))
    states = world.execute(actions).states.astype(np.float32).astype(float)
    world.execute(actions)
    new, ids = DUAL.simulate(obstacles[:3], states), np.array([1])
    world.restart(ids, states[ids])
    np.testing.assert_array_equal(world.receive_all(1).states, new.observe()[ids])
    before, after = (w.carry(ids, actions[ids]) for w in (world, new))
    for name in ("states", "seconds", "outcomes"):
        np.testing.assert_array_equal(getattr(before, name), getattr(after, name))


def test_the_grippers_stay_together_in_phase_1() -> None:
    rng = stream(12, "apart")
    states = np.array([DUAL.random_start(rng) for _ in range(64)])
    for _ in range(20):
        actions = DUAL.unconstrained_sampler.propose(states, rng)
        assert np.linalg.norm(actions[:, :3] - actions[:, 3:], axis=1).max() < 0.70 + 1e-9
        states = np.concatenate([actions, states[:, LAYOUT.action_size :]], axis=1)


def test_collected_data_pass_verification_and_threads_change_no_byte(tmp_path: Path) -> None:
    for phase in (1, 2):
        config = CollectConfig(phase, trajectories=4, lanes=2, steps=2, obstacles_every=1)
        files = [collect(DUAL, config, tmp_path / f"{phase}-{threads}", threads).files for threads in (1, 2)]
        assert files[0] == files[1]
        verify(tmp_path / f"{phase}-1")


def test_random_scenes_are_like_the_papers() -> None:
    (scene,) = generate(DUAL, "random", 1, seed=13)
    assert box_sizes(scene.obstacles) == box_sizes(OBSTACLES)
    assert not scene.goal.reached(scene.state(LAYOUT))
    assert DUAL.simulate([scene.obstacles], scene.state(LAYOUT)[None]).residual[0] < 0.002


def test_authors_scenes_start_where_they_say(authors_scenes: Path) -> None:
    scenes = DUAL.scenes(authors_scenes / "dual_arm.json").scenes
    given = np.array([scene.state(LAYOUT) for scene in scenes])
    world = DUAL.simulate([scene.obstacles for scene in scenes], given)
    off = np.linalg.norm(LAYOUT.points_of(world.observe() - given), axis=-1).mean(axis=1)
    held = np.linalg.norm(world._sites[:, world._ends] - LAYOUT.grippers_of(given), axis=-1)
    assert len(scenes) == 50
    assert held.max() < 0.005
    assert (off < 0.010).sum() >= 45
    assert box_sizes(scenes[0].obstacles) == box_sizes(OBSTACLES)
    assert not world.execute(given[:, : LAYOUT.action_size]).diverged.any()


def test_bad_ropes_and_scenes_are_refused() -> None:
    with pytest.raises(FairleadError, match="odd number"):
        HangingRope(links=24)
    with pytest.raises(FairleadError, match="m apart"):
        ROPE.hanging(np.array([[0.0, 0.5, 1.0], [0.0, -0.5, 1.0]]))
