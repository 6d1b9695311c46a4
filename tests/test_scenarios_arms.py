from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fairlead.core import contracts
from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome, Transitions
from fairlead.core.roles import RecoveryPolicy
from fairlead.geometry.fields import BoxEnvironment
from fairlead.geometry.motion import RandomDisplacement
from fairlead.geometry.shapes import Box
from fairlead.planning.checks import AcceptAll, SpreadThreshold
from fairlead.planning.recovery import NoRecovery, RandomRecovery
from fairlead.scenarios import iiwa
from fairlead.scenarios.arms import CLEARANCE, TOLERANCE, Arms
from fairlead.scenarios.arms_check import ArmsCheck, ArmsRecovery
from fairlead.scenarios.scene_files import read_scenes

ARMS = iiwa.dual_iiwa()
KINEMATICS = ARMS.kinematics
TABLE = Box((0.8, 1.5, 0.12), (0.8, 0.0, 0.565))
POST = Box((0.05, 0.16, 0.3), (0.8, 0.0, 0.775))
TARGET, LIMIT, COLLISION = (
    tuple(ActionOutcome).index(o)
    for o in (ActionOutcome.TARGET, ActionOutcome.JOINT_LIMIT, ActionOutcome.ARM_COLLISION)
)
FORWARD = np.array([1.0, 0.0, 0.0])
seeds = st.integers(0, 2**32 - 1)


def random_postures(rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, arm, joint) within the limits."""
    low, high = KINEMATICS.low[..., 0].T, KINEMATICS.high[..., 0].T
    return rng.uniform(low, high, (count, *low.shape))


def random_grippers(rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, arm, 3) above the table, each on its own side, within reach."""
    low, high = np.array([[0.6, 0.05, 0.75], [0.6, -0.4, 0.75]]), np.array([[1.0, 0.4, 1.2], [1.0, -0.05, 1.2]])
    return rng.uniform(low, high, (count, 2, 3))


def tips(joints: np.ndarray) -> np.ndarray:
    """(batch, arm, 3) [m]."""
    return KINEMATICS.forward(np.ascontiguousarray(joints.T)).tips.T


def denavit_hartenberg(q: np.ndarray) -> np.ndarray:
    """Pose of the flange in the base: Rot_z(q) Trans_z(d) Rot_x(alpha) for the published d [mm] and alpha [degrees]."""
    pose = np.eye(4)
    for angle, d, alpha in zip(q, (360, 0, 420, 0, 400, 0, 126), (-90, 90, 90, -90, -90, 90, 0), strict=True):
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(np.deg2rad(alpha)), np.sin(np.deg2rad(alpha))
        pose = pose @ [[c, -s * ca, s * sa, 0], [s, c * ca, -c * sa, 0], [0, sa, ca, d / 1000], [0, 0, 0, 1]]
    return pose


@given(seeds)
def test_forward_kinematics_is_the_published_chain(seed: int) -> None:
    joints = random_postures(np.random.default_rng(seed), 3)
    posture = KINEMATICS.forward(np.ascontiguousarray(joints.T))
    forth, out = Rotation.from_euler("y", 45, degrees=True), Rotation.from_euler("x", -45, degrees=True)
    for arm, (side, tilt) in enumerate(((1, forth * out), (-1, forth * out.inv()))):
        for row in range(3):
            pose = denavit_hartenberg(joints[row, arm])
            tip = pose[:3] @ [0, 0, iiwa.HAND + iiwa.FINGERS, 1]
            expected = tilt.apply(tip) + np.array([0.086, side * 0.245, 1.248])
            np.testing.assert_allclose(posture.tips[:, arm, row], expected, atol=1e-12)
            np.testing.assert_allclose(posture.directions[:, arm, row], tilt.apply(pose[:3, 2]), atol=1e-12)


@given(seeds)
def test_any_chain_moves_as_the_simulator_says(seed: int) -> None:
    """Random offsets, axes and anchors, several joints on a body, bodies without joints."""
    rng = np.random.default_rng(seed)
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    for name in ("a", "b"):
        body = spec.worldbody
        for part, joints in enumerate((2, 0, 1, 3)):
            body = body.add_body(pos=rng.normal(0, 0.3, 3), quat=Rotation.random(random_state=rng).as_quat())
            for k in range(joints):
                body.add_joint(name=f"{name}{part}{k}", axis=rng.normal(size=3), pos=rng.normal(0, 0.1, 3),
                               range=[-3, 3], armature=0.1)  # fmt: skip
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=rng.normal(0, 0.2, 6), size=[0.02, 0, 0])
        body.add_site(name=name, pos=rng.normal(0, 0.1, 3), quat=rng.normal(size=4))
    spec.add_key(name="home", qpos=rng.uniform(-1, 1, 12))
    model = spec.compile()
    arms = Arms(model, ("a", "b"), [1.0] * 6)
    data = mujoco.MjData(model)
    q = rng.uniform(-3, 3, (2, 6))
    data.qpos[arms.kinematics.joints] = q.T
    mujoco.mj_kinematics(model, data)
    posture = arms.kinematics.forward(q.T[..., None])
    np.testing.assert_allclose(posture.tips[..., 0].T, data.site_xpos, atol=1e-9)
    np.testing.assert_allclose(posture.directions[..., 0].T, data.site_xmat.reshape(2, 3, 3)[..., 2], atol=1e-9)
    starts, ends, _ = arms.capsules(q)
    np.testing.assert_allclose((starts + ends) / 2, data.geom_xpos, atol=1e-9)


@given(seeds)
def test_the_jacobian_is_the_derivative(seed: int) -> None:
    q = np.ascontiguousarray(random_postures(np.random.default_rng(seed), 2).T)
    jacobian = KINEMATICS.jacobian(KINEMATICS.forward(q))
    for j in range(len(q)):
        step = np.zeros_like(q)
        step[j] = 1e-6
        after, before = KINEMATICS.forward(q + step), KINEMATICS.forward(q - step)
        slope = np.concatenate([after.tips - before.tips, after.directions - before.directions]) / 2e-6
        np.testing.assert_allclose(jacobian[:, j], slope, atol=1e-8)


def test_the_arms_mirror_each_other() -> None:
    rng = np.random.default_rng(0)
    joints = random_postures(rng, 20)
    mirrored = joints[:, ::-1] * iiwa.MIRROR
    at, there = tips(joints), tips(mirrored)
    np.testing.assert_allclose(there, at[:, ::-1] * [1, -1, 1], atol=1e-12)
    grippers = random_grippers(rng, 20)
    grasped, _ = ARMS.grasp(grippers)
    again, _ = ARMS.grasp(grippers[:, ::-1] * [1, -1, 1])
    np.testing.assert_allclose(again, grasped[:, ::-1] * iiwa.MIRROR, atol=1e-9)


def test_grasping_reaches_with_the_tool_down_and_says_what_it_cannot() -> None:
    rng = np.random.default_rng(1)
    grippers = random_grippers(rng, 200)
    joints, reached = ARMS.grasp(grippers)
    assert reached.mean() > 0.97
    gap = np.linalg.norm(tips(joints) - grippers, axis=-1).max(axis=1)
    assert (gap[reached] <= TOLERANCE).all()
    assert np.median(gap) < 1e-5
    directions = KINEMATICS.forward(np.ascontiguousarray(joints.T)).directions
    assert np.quantile(directions[2], 0.9) < -0.8
    assert not ARMS.grasp(grippers + FORWARD)[1].any()


def walk(rng: np.random.Generator, boxes: list[Box], steps: int, count: int = 64):
    """Random actions one after the other: (joints, grippers, targets, path) of each."""
    grippers = random_grippers(rng, count)
    joints, _ = ARMS.grasp(grippers)
    for _ in range(steps):
        targets = grippers + rng.normal(0, 0.04, grippers.shape)
        path = ARMS.follow(joints, grippers, targets, [boxes] * count)
        yield joints, grippers, targets, path
        grippers = grippers + (path.reached / 6)[:, None, None] * (targets - grippers)
        joints = path.joints[np.arange(count), path.reached]


def test_paths_are_straight_and_stop_in_time() -> None:
    """No waypoint reached is beyond a limit, off the line, or nearer than the clearance, unless it was so before."""
    boxes = [TABLE, POST]
    low, high = KINEMATICS.low[..., 0].T, KINEMATICS.high[..., 0].T
    seen = set()
    for joints, grippers, targets, path in walk(np.random.default_rng(2), boxes, 12):
        start = ARMS.clearance(joints, [boxes] * 64)
        for k in range(7):
            rows = np.nonzero(path.reached >= k)[0]
            there = path.joints[rows, k]
            wanted = grippers[rows] + k / 6 * (targets - grippers)[rows]
            assert (np.linalg.norm(tips(there) - wanted, axis=-1) <= TOLERANCE + 1e-4).all()
            assert ((there >= low) & (there <= high)).all()
            clear = ARMS.clearance(there, [boxes] * len(rows))
            assert (clear >= np.minimum(CLEARANCE, start[rows]) - 1e-4).all()
        short = path.outcomes != TARGET
        assert (path.reached[~short] == 6).all()
        assert (path.reached[short] < 6).all()
        seen |= set(path.outcomes.tolist())
    assert seen >= {TARGET, COLLISION}
    joints, _ = ARMS.grasp(grippers)
    away = ARMS.follow(joints, grippers, grippers + FORWARD, [boxes] * 64, parts=40)
    assert np.isin(away.outcomes, [LIMIT, COLLISION]).all()
    assert (away.outcomes == LIMIT).any()


def test_moving_down_onto_the_table_stops_above_it() -> None:
    grippers = random_grippers(np.random.default_rng(3), 32)
    joints, _ = ARMS.grasp(grippers)
    down = grippers * [1, 1, 0] + [0, 0, 0.55]
    path = ARMS.follow(joints, grippers, down, [[TABLE]] * 32, parts=40)
    assert (path.outcomes == COLLISION).all()
    height = tips(path.joints[np.arange(32), path.reached])[..., 2].min(axis=1)
    assert (height > 0.625).all()
    assert (height < 0.66).all()


def test_what_starts_in_a_collision_may_leave_it() -> None:
    grippers = np.array([[[0.8, 0.1, 0.8], [0.8, -0.25, 0.8]]])
    joints, _ = ARMS.grasp(grippers)
    boxes = [[TABLE, Box((0.05, 0.05, 0.3), (0.8, 0.1, 0.8))]]
    assert ARMS.clearance(joints, boxes)[0] < 0
    out, deeper = grippers + np.array([[[0, 0.1, 0], [0, 0, 0]], [[0, 0, -0.1], [0, 0, 0]]])[:, None]
    assert ARMS.follow(joints, grippers, out, boxes).outcomes[0] == TARGET
    assert ARMS.follow(joints, grippers, deeper, boxes).outcomes[0] == COLLISION
    assert ARMS.follow(joints, grippers, grippers, boxes).outcomes[0] == TARGET


def test_no_rows_are_no_paths() -> None:
    none = np.zeros((0, 2, 3))
    joints, reached = ARMS.grasp(none)
    path = ARMS.follow(joints, none, none, [])
    assert (joints.shape, reached.shape) == ((0, 2, 7), (0,))
    assert (path.joints.shape, path.outcomes.shape) == ((0, 7, 2, 7), (0,))


def test_seconds_are_the_fastest_joints() -> None:
    *_, path = next(walk(np.random.default_rng(4), [TABLE], 1))
    speed = np.abs(np.diff(path.joints, axis=1)) / iiwa.SPEED_LIMITS
    for row in range(64):
        assert path.seconds[row] == pytest.approx(speed[row, : path.reached[row]].max(axis=(1, 2)).sum())


@pytest.mark.parametrize("count", [1, 2, 7])
def test_a_row_does_not_depend_on_its_batch(count: int) -> None:
    rng = np.random.default_rng(5)
    grippers = random_grippers(rng, 24)
    targets = grippers + rng.normal(0, 0.05, grippers.shape)
    boxes = [[TABLE, POST], [TABLE]] * 12
    joints, _ = ARMS.grasp(grippers)
    path = ARMS.follow(joints, grippers, targets, boxes)
    part = slice(11, 11 + count)
    assert ARMS.grasp(grippers[part])[0].tobytes() == joints[part].tobytes()
    alone = ARMS.follow(joints[part], grippers[part], targets[part], boxes[part])
    for name in ("joints", "reached", "seconds", "outcomes"):
        assert getattr(alone, name).tobytes() == getattr(path, name)[part].tobytes(), name


def test_the_posture_hardly_depends_on_the_way() -> None:
    """Postures carried along a walk end the next action as postures grasped anew do."""
    same, total = 0, 0
    for _, grippers, targets, path in walk(np.random.default_rng(6), [TABLE, POST], 15):
        fresh, _ = ARMS.grasp(grippers)
        again = ARMS.follow(fresh, grippers, targets, [[TABLE, POST]] * 64)
        same, total = same + int((again.outcomes == path.outcomes).sum()), total + 64
    assert same / total >= 0.97


def test_the_arms_do_not_pass_through_each_other() -> None:
    grippers = np.array([[[0.8, 0.2, 0.9], [0.8, -0.2, 0.9]]])
    joints, _ = ARMS.grasp(grippers)
    path = ARMS.follow(joints, grippers, grippers[:, ::-1], [[]], parts=40)
    assert path.outcomes[0] == COLLISION
    assert 0 < path.reached[0] < 20


def transitions(rng: np.random.Generator, layout: StateLayout, count: int) -> Transitions:
    grippers = random_grippers(rng, count)
    states = layout.join(grippers, rng.uniform(0.6, 1.0, (count, layout.points, 3)))
    actions = (grippers + rng.normal(0, 0.15, grippers.shape)).reshape(count, -1)
    return Transitions(states, actions, states + 0.01, np.full(count, 0.1))


def test_the_check_keeps_its_contract_and_knows_the_arms() -> None:
    layout = StateLayout(("left_gripper", "right_gripper"), 4)
    environment = BoxEnvironment([TABLE, POST], np.array([[0.4, -0.6, 0.6], [1.2, 0.6, 1.3]]))
    examples = transitions(np.random.default_rng(7), layout, 24)
    for inner in (AcceptAll(), SpreadThreshold(0.2)):
        check = ArmsCheck(inner, layout, ARMS)
        contracts.check_transition_check(check, environment, examples)
        code = check.encode(environment, examples.states)
        chance = check.probability(environment, examples, code, code)
        grippers, targets = layout.grippers_of(examples.states), layout.grippers_of(examples.actions)
        path = ARMS.follow(ARMS.grasp(grippers)[0], grippers, targets, [environment.boxes] * 24)
        np.testing.assert_array_equal(chance > 0, path.outcomes == TARGET)
        assert 0 < (chance > 0).sum() < 24
    rejecting = ArmsCheck(SpreadThreshold(0.01), layout, ARMS)
    inner = SpreadThreshold(0.01).probability(environment, examples, code, code)
    np.testing.assert_array_equal(rejecting.probability(environment, examples, code, code), inner)


def test_recovery_asks_again_for_what_the_arms_can_do() -> None:
    layout = StateLayout(("left_gripper", "right_gripper"), 4)
    environment = BoxEnvironment([TABLE, POST], np.array([[0.4, -0.6, 0.6], [1.2, 0.6, 1.3]]))
    states = transitions(np.random.default_rng(7), layout, 24).states
    sampler = RandomDisplacement(layout, 0.4, (0.4, -0.6, 0.6), (1.2, 0.6, 1.3), planar=False)

    def reached(policy: RecoveryPolicy) -> int:
        actions = policy.choose(environment, states, np.random.default_rng(0))
        assert actions is not None
        grippers, targets = layout.grippers_of(states), layout.grippers_of(actions)
        path = ARMS.follow(ARMS.grasp(grippers)[0], grippers, targets, [environment.boxes] * 24)
        return int((path.outcomes == TARGET).sum())

    random = RandomRecovery(sampler)
    assert reached(ArmsRecovery(random, layout, ARMS)) > reached(random)
    assert reached(ArmsRecovery(random, layout, ARMS, tries=1)) == reached(random)
    assert ArmsRecovery(NoRecovery(), layout, ARMS).choose(environment, states, np.random.default_rng(0)) is None
    random.extensions = 7  # what the inner policy has checked is charged
    policy = ArmsRecovery(random, layout, ARMS)
    reached(policy)
    assert policy.extensions == 7


def test_the_given_starts_and_goals_are_within_reach(authors_scenes: Path) -> None:
    layout = StateLayout(("left_gripper", "right_gripper"), 25)
    scenes = read_scenes(authors_scenes / "dual_arm.json", "dual_arm", layout).scenes
    boxes = [[TABLE, *(box for obstacle in scene.obstacles for box in obstacle.boxes)] for scene in scenes]
    grippers = np.stack([layout.grippers_of(scene.state(layout)) for scene in scenes])
    joints, reached = ARMS.grasp(grippers)
    assert reached.all()
    assert (ARMS.clearance(joints, boxes) >= 0.05).all()
    around = np.array([
        [[x, y + shift, z], [-x, shift - y, z]]
        for x in (-0.1, 0.0, 0.1) for y in (0.1, 0.2, 0.3) for shift in (-0.1, 0.0, 0.1) for z in (0.1, 0.2)
    ])  # fmt: skip
    for scene, obstacles in zip(scenes, boxes, strict=True):
        joints, reached = ARMS.grasp(np.array(scene.goal.written()["position"]) + around)
        assert (reached & (ARMS.clearance(joints, [obstacles] * len(around)) >= CLEARANCE)).any(), scene.name
