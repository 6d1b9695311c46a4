"""Laws of the dragging world: known answers of its physics, and what every caller relies on."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from fairlead.core.errors import FairleadError
from fairlead.core.records import ActionOutcome
from fairlead.core.streams import stream
from fairlead.scenarios.dragging import OBSTACLES
from fairlead.scenarios.dragging_world import LAYOUT, WALLS, DraggingWorld, Gripper, build_spec
from fairlead.scenarios.obstacles import box_sizes
from fairlead.scenarios.registry import scenario
from fairlead.scenarios.rope import PlanarRope

ROPE, GRIPPER = PlanarRope(), Gripper()
DRAGGING = scenario("dragging")


def _straight(heading: float = 0.0, gripper: tuple[float, float] = (0.2, 0.0)) -> np.ndarray:
    state = np.full(LAYOUT.state_size, ROPE.height)
    state[:2] = gripper
    direction = np.tile([np.cos(heading), np.sin(heading)], (ROPE.links, 1))
    LAYOUT.points_of(state)[:, :2] = state[:2] + ROPE.centre_weights @ direction
    return state


def _links_from_sites(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    return np.array([data.site(f"point{i}").xpos for i in range(ROPE.links)])


def _random_worlds(count: int, seed: int, threads: int = 1):
    rng = stream(seed, "worlds")
    states = np.array([DRAGGING.random_start(rng) for _ in range(count)])
    obstacles = [DRAGGING.random_obstacles(state, rng) for state in states]
    return DRAGGING.simulate(obstacles, states, threads), obstacles, rng


def _penetration(world: DraggingWorld, copy: int) -> float:
    """How deep [m] the deepest contact with a wall or an obstacle is; feet and floor left out."""
    model, data = world.simulation.model, world.simulation.batch.get_data(copy)
    mujoco.mj_forward(model, data)
    floor = model.geom("floor").id
    touching = (data.contact.geom != floor).all(axis=1)
    return float(-data.contact.dist[touching].min(initial=0.0))


def test_free_fall() -> None:
    """With gravity turned into the plane nothing touches, and every point falls g t (t + dt) / 2."""
    model = build_spec((), ROPE, GRIPPER).compile()
    model.opt.gravity[:] = [0, -9.81, 0]
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    start = _links_from_sites(model, data)
    mujoco.mj_step(model, data, 50)
    mujoco.mj_kinematics(model, data)
    t = data.time
    fallen = start[:, 1] - _links_from_sites(model, data)[:, 1]
    np.testing.assert_allclose(fallen, 9.81 * t * (t + model.opt.timestep) / 2, rtol=1e-6)


def test_hanging_rope_is_a_catenary() -> None:
    """In a chain of equal rods at rest, the slope of the links grows by m g / H from link to link."""
    spec = build_spec((), ROPE, GRIPPER)
    spec.option.gravity = [0, -9.81, 0]
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    site = spec.worldbody.add_site(name="pin", pos=[-0.3, 0, ROPE.height])
    tail = next(body for body in spec.bodies if body.name == "link0")
    end = tail.add_site(name="end", pos=[ROPE.link_length, 0, 0])
    spec.add_equality(name="tail", type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_SITE,

                      name1=end.name, name2=site.name)  # fmt: skip
    for joint in spec.joints:
        if joint.name.startswith("hinge"):
            joint.damping[0] = 0.01
        if joint.name.startswith("gripper"):
            joint.stiffness[0], joint.damping[0] = 1e5, 1e3
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[model.joint("hinge9").qposadr[0]] = np.pi
    data.qpos[:2] = 0.0
    for _ in range(20_000):
        mujoco.mj_step(model, data)
    mujoco.mj_kinematics(model, data)
    joints = np.array([data.body(f"link{i}").xpos for i in range(ROPE.links - 1)] + [data.site("end").xpos])
    ends = np.concatenate([joints[-1:], joints[:-1]])[:, :2]
    slope = np.diff(ends[:, 1]) / np.diff(ends[:, 0])
    growth = np.diff(slope)
    assert np.abs(data.qvel).max() < 1e-4
    assert abs(growth.mean()) > 0.05
    np.testing.assert_allclose(growth, growth.mean(), rtol=0.01)


def test_sliding_friction_decelerates_as_mu_m_g() -> None:
    model = build_spec((), ROPE, GRIPPER).compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 50)
    data.qvel[0] = 0.5
    mujoco.mj_step(model, data, 100)
    mass = ROPE.links * ROPE.link_mass
    expected = ROPE.friction * mass * 9.81 / (mass + GRIPPER.mass)
    np.testing.assert_allclose((0.5 - data.qvel[0]) / (100 * model.opt.timestep), expected, rtol=0.03)


def test_observation_is_mujocos_own_kinematics() -> None:
    world, _, rng = _random_worlds(3, 1)
    world.execute(DRAGGING.sampler.propose(world.observe(), rng))
    for i, state in enumerate(world.observe()):
        data = world.simulation.batch.get_data(i)
        mujoco.mj_kinematics(world.simulation.model, data)
        sites = _links_from_sites(world.simulation.model, data)
        np.testing.assert_allclose(LAYOUT.points_of(state)[:, :2], sites[:, :2], atol=1e-9)


def test_full_force_pushes_neither_tunnel_nor_sink() -> None:
    """1,024 pushes of full length into whatever is there; checked while the force acts, not after settling."""
    count, worst = 64, 0.0
    world, obstacles, rng = _random_worlds(count, 2, threads=2)
    fields = [DRAGGING.environment(o) for o in obstacles]
    everyone = np.arange(count, dtype=np.int32)
    for _ in range(16):
        yaw = rng.uniform(-np.pi, np.pi, count)
        world._begin(everyone, world.simulation.qpos[:, :2] + 0.3 * np.stack([np.cos(yaw), np.sin(yaw)], -1))
        for k in range(1, 251):
            world._clock[:] = k
            world._drive()
            world.simulation.step(everyone)
            if k % 50 == 0:
                for i, (field, state) in enumerate(zip(fields, world.observe(), strict=True)):
                    assert field.signed_distance(state.reshape(-1, 3)).min() > 0, "a point is inside an obstacle"
                    worst = max(worst, _penetration(world, i))
    assert not world.simulation.diverged(everyone).any()
    assert worst < 0.003, f"penetration of {1000 * worst:.2f} mm"


def test_state_at_rest_does_not_drift() -> None:
    world, _, rng = _random_worlds(16, 3)
    for _ in range(5):
        world.execute(DRAGGING.sampler.propose(world.observe(), rng))
    before = world.observe()
    world._hold(np.arange(16), before[:, :2])
    for _ in range(750):
        world._tick(np.arange(16))
    moved = np.linalg.norm(world.observe() - before, axis=1)
    assert moved.max() < 0.001


def test_largest_bend_is_at_least_150_degrees() -> None:
    state = _straight()
    heading = np.r_[np.full(5, np.radians(155)), np.zeros(5)]
    direction = np.stack([np.cos(heading), np.sin(heading)], -1)
    LAYOUT.points_of(state)[:, :2] = state[:2] + ROPE.centre_weights @ direction
    world = DRAGGING.simulate([()], state[None])
    assert world.residual[0] < 1e-3
    links = ROPE.headings(world.observe()[:, :3], LAYOUT.points_of(world.observe()))
    assert np.degrees(np.abs(np.diff(links)).max()) > 150


def test_thread_count_changes_nothing() -> None:
    results = []
    for threads in (1, 2):
        world, _, rng = _random_worlds(8, 4, threads)
        results.append([world.execute(DRAGGING.sampler.propose(world.observe(), rng)).states for _ in range(3)])
    np.testing.assert_array_equal(results[0], results[1])


def test_rows_do_not_influence_each_other() -> None:
    together, obstacles, rng = _random_worlds(6, 5)
    starts = together.observe()
    actions = DRAGGING.sampler.propose(starts, rng)
    alone = DRAGGING.simulate(obstacles[2:3], starts[2:3]).execute(actions[2:3]).states
    again = DRAGGING.simulate(obstacles, starts).execute(actions).states[2:3]
    np.testing.assert_array_equal(alone, again)


@pytest.mark.parametrize("wanted", [1, 3])
def test_copies_need_not_wait_for_each_other(wanted: int) -> None:
    """Copies that go on as soon as each, or some, are at rest end where they end in lockstep."""
    lockstep, obstacles, rng = _random_worlds(5, 8)
    world = DRAGGING.simulate(obstacles, lockstep.observe())
    shifts = rng.uniform(-0.1, 0.1, (3, 5, 2))
    lockstep = DRAGGING.simulate(obstacles, lockstep.observe())
    for shift in shifts:
        target = lockstep.observe()[:, :3]
        lockstep.execute(np.c_[target[:, :2] + shift, target[:, 2]])
    taken, ready = np.zeros(5, int), np.arange(5)
    while (taken < 3).any():
        target = world.observe()[ready, :3]
        world.send(ready, np.c_[target[:, :2] + shifts[taken[ready], ready], target[:, 2]])
        acting = len(world._active)
        ids, _ = world.receive(wanted)
        assert len(ids) >= min(wanted, acting)
        taken[ids] += 1
        ready = ids[taken[ids] < 3]
    np.testing.assert_array_equal(world.observe(), lockstep.observe())


def test_a_copy_that_restarts_alone_is_as_in_a_new_world() -> None:
    """Whatever it and the others did before: recording may go on with each trajectory as if all had begun together."""
    world, obstacles, rng = _random_worlds(4, 9)
    world.execute(DRAGGING.sampler.propose(world.observe(), rng))
    states, actions = world.observe().astype(np.float32).astype(float), DRAGGING.sampler.propose(world.observe(), rng)
    world.execute(actions)
    new, ids = DRAGGING.simulate(obstacles, states), np.array([2])
    world.restart(ids, states[ids])
    np.testing.assert_array_equal(world.receive_all(1).states, new.observe()[ids])
    np.testing.assert_array_equal(world.carry(ids, actions[ids]).states, new.execute(actions).states[ids])


def test_an_observed_state_can_be_simulated_again() -> None:
    """Quasi-static: the 33 numbers say enough to repeat an action within half a millimetre."""
    world, obstacles, rng = _random_worlds(24, 6)
    for _ in range(4):
        world.execute(DRAGGING.sampler.propose(world.observe(), rng))
    before = world.observe()
    actions = DRAGGING.sampler.propose(before, rng)
    first = world.execute(actions).states
    second = DRAGGING.simulate(obstacles, before).execute(actions).states
    assert np.median(np.abs(first - second).max(axis=1)) < 0.0005


@pytest.mark.parametrize("speed", [np.nan, 1e4])
def test_divergence_is_found_and_never_observed(speed: float) -> None:
    world, _, rng = _random_worlds(3, 7)
    before = world.observe()
    drive = world._drive

    def break_one() -> None:
        drive()
        if 1 in world._active:
            world.simulation.qvel[1] = speed

    world._drive = break_one
    executed = world.execute(DRAGGING.sampler.propose(before, rng))
    assert executed.diverged.tolist() == [False, True, False]
    assert np.isfinite(executed.states).all()
    np.testing.assert_allclose(executed.states[1], before[1], atol=1e-9)
    world._drive = drive
    again = world.execute(DRAGGING.sampler.propose(executed.states, rng))
    assert not again.diverged.any(), "a copy that diverged once goes on"


def test_there_is_nothing_to_receive_before_something_is_sent() -> None:
    with pytest.raises(FairleadError, match="send some first"):
        DRAGGING.simulate([()], _straight()[None]).receive()


def test_outcomes_tell_free_from_blocked() -> None:
    free, blocked = _straight(gripper=(0.0, 0.0)), _straight(np.pi, gripper=(0.9, 0.0))
    world = DRAGGING.simulate([(), ()], np.array([free, blocked]))
    action = np.array([[-0.1, 0, ROPE.height], [0.95, 0.3, ROPE.height]])
    outcomes = [tuple(ActionOutcome)[i] for i in world.execute(action).outcomes]
    assert outcomes == [ActionOutcome.TARGET, ActionOutcome.TIMEOUT]


def test_random_scenes_are_like_the_papers(tmp_path: Path) -> None:
    for i in range(3):
        scene = DRAGGING.random_scene(stream(8, i), f"scene-{i}")
        DRAGGING.validate(scene)
        assert box_sizes(scene.obstacles) == box_sizes(OBSTACLES)
        assert DRAGGING.environment(scene.obstacles).signed_distance(np.array(scene.goal.written()["position"])) > 0.1
        corners = np.array([c for o in scene.obstacles for b in o.boxes for c in b.corners()])
        assert np.abs(corners[:, :2]).max() < WALLS[0].position[0]


def test_authors_scenes_start_where_they_say(authors_scenes: Path) -> None:
    scenes = DRAGGING.scenes(authors_scenes / "dragging.json").scenes
    states = np.array([scene.state(LAYOUT) for scene in scenes])
    world = DRAGGING.simulate([scene.obstacles for scene in scenes], states)
    assert len(scenes) == 50
    assert np.median(world.residual) <= 0.005
    assert world.residual.max() <= 0.015


def test_a_rope_without_links_is_refused() -> None:
    with pytest.raises(Exception, match="at least two links"):
        PlanarRope(links=1)


def test_the_world_has_no_preferred_direction() -> None:
    """Turned starts and actions lead to turned outcomes: friction is a cone, not a pyramid along the axes."""
    rng = stream(9, "turn")
    starts = np.array([DRAGGING.random_start(rng) for _ in range(12)])
    actions = DRAGGING.unconstrained_sampler.propose(starts, rng)
    turn = np.eye(3)
    turn[:2, :2] = [[np.cos(0.6), -np.sin(0.6)], [np.sin(0.6), np.cos(0.6)]]

    def turned(vectors: np.ndarray) -> np.ndarray:
        return (vectors.reshape(len(vectors), -1, 3) @ turn.T).reshape(len(vectors), -1)

    straight = DRAGGING.simulate_unconstrained(starts).execute(actions).states
    other = DRAGGING.simulate_unconstrained(turned(starts)).execute(turned(actions)).states
    assert np.abs(turned(straight) - other).max() < 0.0005
