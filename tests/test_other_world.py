"""The other world: without differences it is the world of training; with them it keeps the contract of a world."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fairlead.core.contracts import check_world
from fairlead.core.errors import FairleadError
from fairlead.core.streams import stream
from fairlead.scenarios.dual_arm import POSE
from fairlead.scenarios.other_world import MOCKUP, Differences, misplaced, other_world, with_arms_of
from fairlead.scenarios.panda import SHOULDER, TILT, TIP, dual_panda
from fairlead.scenarios.registry import scenario
from fairlead.scenarios.rope import RopeFactors

SCENARIOS = ("dragging", "dual_arm")
factors = st.floats(0.1, 4.0)


def scene(name: str):
    world, rng = scenario(name), stream(3, "scene")
    start = world.random_start(rng)
    return world, world.random_obstacles(start, rng), start, rng


@pytest.mark.parametrize("name", SCENARIOS)
def test_no_difference_is_the_world_of_training(name: str) -> None:
    world, obstacles, start, rng = scene(name)
    same, other = world.simulate([obstacles], start[None]), other_world(world, obstacles, start, Differences(), rng)
    np.testing.assert_array_equal(other.observe(), same.observe())
    action = world.sampler.propose(same.observe(), stream(3, "action"))
    ours, theirs = other.execute(action), same.execute(action)
    np.testing.assert_array_equal(ours.states, theirs.states)
    np.testing.assert_array_equal(ours.seconds, theirs.seconds)


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_difference_at_once_is_still_a_world_and_another_one(name: str) -> None:
    world, obstacles, start, rng = scene(name)
    other = other_world(world, obstacles, start, MOCKUP, rng)
    action = world.sampler.propose(other.observe(), stream(3, "action"))
    same = world.simulate([obstacles], start[None]).execute(action)
    grippers = world.layout.grippers_of(other.observe())
    np.testing.assert_array_equal(grippers, world.layout.grippers_of(other.inner.observe()))
    noise = world.layout.points_of(other.observe() - other.inner.observe())
    assert 0.5 < noise.std() / MOCKUP.sensing_m < 1.5
    check_world(other, action)
    assert not np.allclose(other.observe(), same.states, atol=1e-3)


def test_planning_knows_the_arms_that_carry_it_out_and_nothing_else_of_what_differs() -> None:
    world = scenario("dual_arm")
    assert with_arms_of(world, None) is world
    assert with_arms_of(world, Differences(mass=2.0)) is world
    known = with_arms_of(world, MOCKUP)
    assert known.arms is not None
    np.testing.assert_array_equal(known.arms.home, dual_panda().home)
    assert known.rope == world.rope  # type: ignore[attr-defined]


@given(mass=factors, friction=factors, sensing_m=st.floats(0, 0.01), stiffness=st.floats(0, 0.1))
def test_differences_are_read_as_they_are_written(**values: float) -> None:
    written = replace(Differences(), **{name: float(f"{value:g}") for name, value in values.items()})
    if str(written):
        assert Differences.parse(str(written)) == written
    assert Differences.parse("arms=panda,mass=2") == Differences(mass=2.0, arms="panda")
    assert Differences.parse("mockup") == MOCKUP == Differences.parse(str(MOCKUP))


@pytest.mark.parametrize(
    "text", ["", "mass", "mass=heavy", "wind=3", "mass=0", "friction=-1", "delay_s=nan", "arms=six", "mass=2,mass=3"]
)
def test_what_is_no_difference_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(FairleadError, match=r"^[^\n]*difference[^\n]*$"):
        Differences.parse(text)


@given(seed=st.integers(0, 2**32))
def test_obstacles_stay_near_where_planning_sees_them(seed: int) -> None:
    obstacle = scenario("dragging").random_obstacles(np.full(33, 0.02), stream(1, "obstacle"))[0]
    moved = misplaced(obstacle, 0.005, np.random.default_rng(seed))
    shifts = np.subtract([box.position for box in moved.boxes], [box.position for box in obstacle.boxes])
    assert (np.linalg.norm(shifts, axis=1) <= 0.005 + 1e-12).all()
    assert np.ptp(shifts, axis=0).max() < 1e-12
    assert (shifts[:, 2] == 0).all()


@pytest.mark.parametrize("name", SCENARIOS)
def test_another_rope_is_heavier_longer_and_rubs_more(name: str) -> None:
    world = scenario(name)
    rope = world.altered(RopeFactors(2.0, 3.0, 4.0, 1.1, 0.01)).rope  # type: ignore[attr-defined]
    assert rope.link_mass == 2 * world.rope.link_mass  # type: ignore[attr-defined]
    assert np.allclose(rope.friction, np.multiply(3, world.rope.friction))  # type: ignore[attr-defined]
    assert (rope.damping, rope.stiffness) == (4 * world.rope.damping, 0.01)  # type: ignore[attr-defined]
    assert rope.link_length == 1.1 * world.rope.link_length  # type: ignore[attr-defined]


def test_the_other_arms_are_the_published_chain_and_reach_over_the_table() -> None:
    """At all angles zero, by hand: 0.333 + 0.316 + 0.384 m up, 0.088 m out, the hand pointing back down."""
    arms = dual_panda()
    posture = arms.kinematics.forward(np.zeros((7, 2, 1)))
    for arm, side in enumerate((1, -1)):
        base = Rotation.from_euler("xy", (side * TILT[0], TILT[1]), degrees=True)
        tip = base.apply([0.088, 0.0, 0.333 + 0.316 + 0.384 - TIP]) + np.multiply(SHOULDER, [1, side, 1])
        np.testing.assert_allclose(posture.tips[:, arm, 0], tip, atol=1e-9)
    grippers = stream(4, "reach").uniform(POSE[0], POSE[1], (100, 2, 3))
    joints, reached = arms.grasp(grippers)
    assert reached.mean() > 0.95
    down = arms.kinematics.forward(np.ascontiguousarray(joints.T)).directions[2]
    assert np.quantile(down, 0.9) < -0.8
