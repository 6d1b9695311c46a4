"""Laws of geometry: exact distances, fields, and motion."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from fairlead.core.layout import StateLayout
from fairlead.core.roles import Environment
from fairlead.geometry.distance import model_error, point_error
from fairlead.geometry.fields import BoxEnvironment, GridEnvironment
from fairlead.geometry.motion import RandomDisplacement
from fairlead.geometry.shapes import Box, Obstacle, box_distance

LAYOUT = StateLayout(("gripper",), 3)
BOUNDS = np.array([[-0.5, -0.5, -0.1], [0.5, 0.5, 0.1]])
sizes = st.tuples(*[st.floats(0.05, 0.5)] * 3)
places = st.tuples(*[st.floats(-0.4, 0.4)] * 3)
yaws = st.floats(-np.pi, np.pi)
seeds = st.integers(0, 10**6)


def points_in(bounds: np.ndarray, count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(*bounds, size=(count, 3))


@given(size=sizes, position=places, yaw=yaws, seed=seeds)
def test_the_distance_to_a_box_is_the_closed_form_in_its_own_frame(
    size: tuple, position: tuple, yaw: float, seed: int
) -> None:
    box = Box(size, (0.0, 0.0, 0.0))
    local = points_in(3 * BOUNDS, 50, seed)
    half = np.array(size) / 2
    gap = np.abs(local) - half
    outside = np.linalg.norm(np.maximum(gap, 0), axis=1)
    inside = -(half - np.abs(local)).min(axis=1)
    expected = np.where((gap < 0).all(axis=1), inside, outside)
    np.testing.assert_allclose(box_distance([box], local), expected, atol=1e-12)
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    moved = box_distance([box.moved(position, yaw)], local @ turn.T + position)
    np.testing.assert_allclose(moved, expected, atol=1e-9)


@given(size=sizes, position=places, yaw=yaws, seed=seeds)
def test_distances_are_lipschitz_and_that_of_a_union_is_the_least(
    size: tuple, position: tuple, yaw: float, seed: int
) -> None:
    boxes = [Box(size, position).moved((0.1, 0, 0), yaw), Box((0.1, 0.2, 0.3), (0.2, 0.0, 0.0))]
    one, two = points_in(3 * BOUNDS, 40, seed), points_in(3 * BOUNDS, 40, seed + 1)
    d = box_distance(boxes, one)
    assert (np.abs(d - box_distance(boxes, two)) <= np.linalg.norm(one - two, axis=1) + 1e-9).all()
    np.testing.assert_array_equal(d, np.minimum(box_distance(boxes[:1], one), box_distance(boxes[1:], one)))


@given(size=sizes, position=places, yaw=yaws)
def test_corners_and_face_centres_lie_on_the_surface(size: tuple, position: tuple, yaw: float) -> None:
    box = Box(size, position).moved((0.2, -0.1, 0.05), yaw)
    corners = box.corners()
    np.testing.assert_allclose(box_distance([box], corners), 0, atol=1e-9)
    np.testing.assert_allclose(corners.mean(axis=0), box.position, atol=1e-9)
    assert box_distance([box], np.array(box.position)) == pytest.approx(-min(size) / 2)


@given(size=sizes, position=places, one=yaws, two=yaws)
def test_moving_twice_is_moving_once(size: tuple, position: tuple, one: float, two: float) -> None:
    obstacle = Obstacle("thing", (Box(size, position),))
    twice = obstacle.moved((0.0, 0.0, 0.0), one).moved((0.1, 0.2, 0.3), two)
    once = obstacle.moved((0.1, 0.2, 0.3), one + two)
    np.testing.assert_allclose(twice.boxes[0].corners(), once.boxes[0].corners(), atol=1e-9)


@pytest.mark.parametrize(
    ("field", "value"),
    [("size", (1.0, 0.0, 1.0)), ("size", (1.0, -1.0, 1.0)), ("size", (1.0, 1.0)), ("position", (0.0, np.nan, 0.0)),
     ("quaternion_xyzw", (0.0, 0.0, 0.0, 2.0)), ("quaternion_xyzw", (0.0, 0.0, np.inf, 1.0))],
)  # fmt: skip
def test_a_wrong_box_names_its_field(field: str, value: tuple) -> None:
    fields = {"size": (1.0, 1.0, 1.0), "position": (0.0, 0.0, 0.0)} | {field: value}
    with pytest.raises(ValueError, match=f"^{field}: "):
        Box(**fields)


@given(size=sizes, position=places, yaw=yaws, seed=seeds)
def test_distances_at_points_are_exact_and_lead_to_the_surface(
    size: tuple, position: tuple, yaw: float, seed: int
) -> None:
    boxes = [Box(size, (0.0, 0.0, 0.0)).moved(position, yaw), Box((0.1, 0.2, 0.3), (0.3, -0.3, 0.1))]
    environment, points = BoxEnvironment(boxes, BOUNDS), points_in(BOUNDS, 100, seed)
    exact, found = environment.signed_distance(points), environment.distance_and_gradient(points)
    np.testing.assert_allclose(found[:, 0], exact, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(found[:, 1:], axis=1), 1.0, atol=1e-5)
    # x - d grad d lies on the surface: of the union from outside, of one of its boxes from inside.
    surface = environment.signed_distance(points - found[:, :1] * found[:, 1:])
    assert surface.max() < 1e-5
    assert surface[exact > 0].min(initial=0.0) > -1e-5


@given(seed=seeds)
def test_gradients_point_away_from_a_wall(seed: int) -> None:
    environment = BoxEnvironment([Box((0.2, 4.0, 4.0), (-0.5, 0.0, 0.0))], BOUNDS)
    points = points_in(BOUNDS, 50, seed)
    away = points[:, 0] > -0.35
    gradient = environment.distance_and_gradient(points)[away, 1:]
    np.testing.assert_allclose(gradient, np.tile([1.0, 0, 0], (away.sum(), 1)), atol=1e-4)


def cells(environment: Environment, resolution: float) -> tuple[np.ndarray, np.ndarray]:
    grid, origin = environment.occupancy(resolution)
    index = np.stack(np.meshgrid(*map(np.arange, grid.shape), indexing="ij"), axis=-1)
    return grid, origin + resolution * index


@given(size=sizes, position=places, yaw=yaws)
def test_occupancy_says_which_cell_centres_are_inside(size: tuple, position: tuple, yaw: float) -> None:
    environment = BoxEnvironment([Box(size, (0.0, 0.0, 0.0)).moved(position, yaw)], BOUNDS)
    grid, centres = cells(environment, 0.05)
    np.testing.assert_array_equal(grid, environment.signed_distance(centres) < 0)
    np.testing.assert_allclose(centres.reshape(-1, 3).min(axis=0), BOUNDS[0] + 0.025)
    np.testing.assert_allclose(centres.reshape(-1, 3).max(axis=0), BOUNDS[1] - 0.025)
    assert environment.occupancy(0.05)[0] is grid


@given(size=st.tuples(*[st.floats(0.15, 0.5)] * 3), position=places, yaw=yaws, seed=seeds)
def test_a_grid_environment_agrees_with_the_boxes_it_was_made_from(
    size: tuple, position: tuple, yaw: float, seed: int
) -> None:
    resolution = 0.02
    exact = BoxEnvironment([Box(size, (0.0, 0.0, 0.0)).moved(position, yaw)], BOUNDS)
    grid, origin = exact.occupancy(resolution)
    assume(grid.any())
    sensed = GridEnvironment(grid, origin, resolution)
    np.testing.assert_allclose(sensed.bounds, BOUNDS, atol=1e-9)
    points = points_in(BOUNDS, 200, seed)
    difference = np.abs(sensed.signed_distance(points) - exact.signed_distance(points))
    near = exact.signed_distance(points) > -0.05  # deep inside, the map's border hides the nearest face
    assert difference[near].max() < 2.5 * resolution
    clear = np.abs(exact.signed_distance(points)) > resolution
    np.testing.assert_array_equal(sensed.occupied(points)[clear], exact.occupied(points)[clear])


def test_a_grid_has_its_surface_at_the_faces_of_its_cells() -> None:
    exact = BoxEnvironment([Box((0.2, 0.4, 0.4), (0.0, 0.0, 0.0))], BOUNDS)
    sensed = GridEnvironment(*exact.occupancy(0.02), 0.02)
    line = np.linspace(-0.45, 0.45, 181)[:, None] * np.array([1.0, 0.0, 0.0])
    line = line[np.abs(line[:, 0]) > 0.03]  # the middle of the box has no gradient
    np.testing.assert_allclose(sensed.signed_distance(line), np.abs(line[:, 0]) - 0.1, atol=1e-6)


@given(seed=seeds)
def test_a_point_cloud_occupies_its_cells_and_the_rest_is_free(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cloud = rng.uniform(1.2 * BOUNDS[0], 1.2 * BOUNDS[1], size=(30, 3))
    environment = GridEnvironment.from_points(cloud, BOUNDS, 0.05)
    inside = ((cloud > BOUNDS[0] + 1e-6) & (cloud < BOUNDS[1] - 1e-6)).all(axis=1)
    assert environment.occupied(cloud[inside]).all()
    assert not environment.occupied(cloud[~inside]).any()
    assert environment.occupancy(0.05)[0].sum() <= inside.sum()


def test_an_empty_map_is_far_from_everything() -> None:
    empty = GridEnvironment(np.zeros((4, 4, 4), bool), np.zeros(3), 0.1)
    assert not empty.occupied(np.zeros((1, 3))).any()
    assert empty.signed_distance(np.zeros((1, 3)))[0] > 100
    assert BoxEnvironment([], BOUNDS).signed_distance(np.zeros((1, 3)))[0] > 100
    assert np.isfinite(BoxEnvironment([], BOUNDS).distance_and_gradient(np.zeros((1, 3)))).all()


@given(seed=seeds)
def test_model_error_is_a_norm_over_the_rope_that_ignores_grippers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, two, three = rng.normal(size=(3, 6, LAYOUT.state_size))
    error = model_error(LAYOUT, one, two)
    np.testing.assert_allclose(error, np.sqrt(((one - two)[:, 3:] ** 2).sum(axis=1)))
    np.testing.assert_allclose(error, model_error(LAYOUT, two, one))
    assert (error <= model_error(LAYOUT, one, three) + model_error(LAYOUT, three, two) + 1e-12).all()
    moved = one.copy()
    moved[:, :3] += 1.0
    assert (model_error(LAYOUT, one, moved) == 0).all()
    assert (point_error(LAYOUT, one, two) <= error / np.sqrt(LAYOUT.points) + 1e-12).all()
    shifted = LAYOUT.join(LAYOUT.grippers_of(one), LAYOUT.points_of(one) + np.array([0.3, 0.0, 0.4]))
    np.testing.assert_allclose(point_error(LAYOUT, one, shifted), 0.5)


def test_without_an_object_the_model_error_is_that_of_the_robot() -> None:
    one, other = np.zeros((1, 3)), np.array([[0.3, 0.4, 0.0]])
    for error in (model_error, point_error):
        np.testing.assert_allclose(error(StateLayout(("robot",), 0), one, other), [0.5])


@given(seed=seeds, planar=st.booleans(), reach=st.floats(0.01, 1.0))
def test_random_actions_stay_in_reach_and_in_bounds(seed: int, planar: bool, reach: float) -> None:
    rng = np.random.default_rng(seed)
    layout = StateLayout(("left", "right"), 2)
    sampler = RandomDisplacement(layout, reach, (-0.5, -0.5, 0.0), (0.5, 0.5, 0.3), planar)
    states = rng.uniform(0.0, 0.3, (40, layout.state_size))
    moved = sampler.displacements(200, rng)
    assert np.linalg.norm(moved, axis=-1).max() <= reach + 1e-12
    assert (moved[..., 2] == 0).all() == planar
    targets = sampler.propose(states, rng).reshape(40, 2, 3)
    assert (targets >= sampler.low).all()
    assert (targets <= sampler.high).all()
    assert (np.linalg.norm(targets - layout.grippers_of(states), axis=-1) <= reach + 1e-12).all()


def test_headings_and_lengths_are_uniform() -> None:
    sampler = RandomDisplacement(LAYOUT, 0.15, (-9.0,) * 3, (9.0,) * 3, planar=True)
    moved = sampler.displacements(20_000, np.random.default_rng(0))[:, 0]
    length, heading = np.linalg.norm(moved, axis=1), np.arctan2(moved[:, 1], moved[:, 0])
    for values, low, high in ((length, 0.0, 0.15), (heading, -np.pi, np.pi)):
        counts, _ = np.histogram(values, bins=10, range=(low, high))
        assert counts.sum() == 20_000
        assert np.abs(counts - 2000).max() < 5 * np.sqrt(2000)


@given(seed=seeds)
def test_repeating_asks_for_the_same_displacement_again(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sampler = RandomDisplacement(LAYOUT, 0.15, (-9.0,) * 3, (9.0,) * 3, planar=False)
    states, after = rng.uniform(-1, 1, (2, 10, LAYOUT.state_size))
    actions = sampler.propose(states, rng)
    again = sampler.repeat(states, actions, after)
    np.testing.assert_allclose(again - after[:, :3], actions - states[:, :3], atol=1e-12)


@given(seed=seeds)
def test_redrawing_keeps_only_what_may_be_kept(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sampler = RandomDisplacement(LAYOUT, 0.15, (-9.0,) * 3, (9.0,) * 3, planar=True)
    before = sampler.displacements(1000, rng)
    keep = rng.random(1000) < 0.5
    same = (sampler.redraw(before, keep, rng) == before).all(axis=(1, 2))
    assert not same[~keep].any()
    assert 0.7 < same[keep].mean() < 0.9
