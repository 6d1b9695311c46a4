"""Laws of local voxel grids."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fairlead.core.errors import FairleadError
from fairlead.core.layout import StateLayout
from fairlead.geometry.fields import BoxEnvironment
from fairlead.geometry.frames import local_origin
from fairlead.geometry.shapes import Box
from fairlead.learning.voxels import NOTHING, Occupancy, VoxelGrid

BOUNDS = np.array([[-0.5, -0.4, 0.0], [0.5, 0.4, 0.1]])
LAYOUTS = (StateLayout(("gripper",), 4), StateLayout(("left", "right"), 3))
GRIDS = (VoxelGrid((12, 9, 1), 0.02), VoxelGrid((7, 8, 5), 0.05, 400.0))
ENVIRONMENTS = [
    BoxEnvironment([Box((0.2, 0.1, 0.1), (0.1, 0.1, 0.05))], BOUNDS),
    BoxEnvironment([Box((0.1, 0.3, 0.06), (-0.3, 0.0, 0.03), (0, 0, 0.3826834, 0.9238795))], BOUNDS),
]


def some_states(layout: StateLayout, seed: int, count: int = 3) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform([-0.7, -0.6, 0.0], [0.7, 0.6, 0.1], (count, layout.state_size // 3, 3)).reshape(count, -1)


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("layout", LAYOUTS)
@given(seed=st.integers(0, 10_000))
@settings(max_examples=15, deadline=None)
def test_every_cell_holds_what_its_definition_says(layout: StateLayout, grid: VoxelGrid, seed: int) -> None:
    states, which = some_states(layout, seed), np.array([1, 0, 1])
    occupancy = Occupancy.of(ENVIRONMENTS, grid.resolution)
    drawn = grid.draw(layout, occupancy, which, states).numpy()
    assert drawn.shape == (3, grid.channels(layout), *grid.shape)
    corner = grid.corner(layout, states, occupancy.origin)
    cells = np.stack(np.meshgrid(*map(np.arange, grid.shape), indexing="ij"), -1)
    for row, environment in enumerate(which):
        centres = occupancy.origin + grid.resolution * (corner[row] + cells)
        inside = ((centres > BOUNDS[0]) & (centres < BOUNDS[1])).all(-1)
        expected = ENVIRONMENTS[environment].occupied(centres) & inside
        assert (drawn[row, 0] == expected).all()
        groups = [layout.points_of(states)[row], *layout.grippers_of(states)[row][:, None]]
        for channel, points in zip(drawn[row, 1:], groups, strict=True):
            square = ((centres[..., None, :] - points) ** 2).sum(-1)
            np.testing.assert_allclose(channel, np.exp(-grid.sharpness * square).max(-1), atol=1e-5)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_the_origin_lies_in_the_middle_cell(seed: int) -> None:
    layout, grid = LAYOUTS[seed % 2], GRIDS[seed // 2 % 2]
    states = some_states(layout, seed)
    occupancy = Occupancy.of(ENVIRONMENTS, grid.resolution)
    middle = grid.corner(layout, states, occupancy.origin) + np.array(grid.shape) // 2
    off = occupancy.origin + grid.resolution * middle - local_origin(layout, states)
    assert np.abs(off).max() <= (0.5 + 1e-4) * grid.resolution + 1e-9


@pytest.mark.parametrize("resolution", [0.01, 0.02, 0.04])
def test_what_lies_between_two_cells_is_drawn_alike_in_either_precision(resolution: float) -> None:
    """As all ropes on a table do: training sees them in single precision, planning starts in double."""
    layout, grid = LAYOUTS[0], VoxelGrid((12, 9, 4), resolution)
    occupancy, states = Occupancy.of(ENVIRONMENTS, resolution), some_states(layout, 0)
    for heights in (0.02, 0.02 + np.array([-1e-8, 0, 1e-8])[:, None]):
        states[:, 2::3] = heights
        either = (states, states.astype(np.float32))
        double, single = (grid.draw(layout, occupancy, np.zeros(3, int), x) for x in either)
        np.testing.assert_allclose(double, single, atol=1e-3)


@given(seed=st.integers(0, 10_000), cells=st.tuples(st.integers(-3, 3), st.integers(-3, 3)))
@settings(max_examples=6, deadline=None)
def test_moving_everything_by_whole_cells_changes_nothing(seed: int, cells: tuple[int, int]) -> None:
    layout, grid = LAYOUTS[0], GRIDS[0]
    shift = 0.02 * np.array([*cells, 0])
    states = some_states(layout, seed)
    box = Box((0.15, 0.1, 0.1), (0.0103, 0.0307, 0.05))
    moved = Box(box.size, tuple(np.array(box.position) + shift))
    grids = [
        grid.draw(layout, Occupancy.of([BoxEnvironment([b], 4 * BOUNDS)], 0.02), np.zeros(3, int), s).numpy()
        for b, s in ((box, states), (moved, states + np.tile(shift, 5)))
    ]
    same_cell = np.isclose(grids[0][:, 1], grids[1][:, 1], atol=1e-4).all(axis=(1, 2, 3))
    assert same_cell.sum() >= 2  # rounding may snap a state that lies on a cell's edge to either side
    np.testing.assert_allclose(grids[0][same_cell], grids[1][same_cell], atol=1e-4)


def test_environments_of_different_bounds_are_refused() -> None:
    with pytest.raises(FairleadError, match="same bounds"):
        Occupancy.of([ENVIRONMENTS[0], BoxEnvironment([], 2 * BOUNDS)], 0.02)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=10, deadline=None)
def test_no_number_is_so_small_that_a_processor_slows_down(seed: int) -> None:
    layout, grid = LAYOUTS[0], VoxelGrid((30, 30, 3), 0.02)
    drawn = grid.draw(layout, Occupancy.of(ENVIRONMENTS, 0.02), np.zeros(3, int), some_states(layout, seed)).numpy()
    assert np.all((drawn == 0) | (drawn >= NOTHING))
    assert (drawn[:, 1] == 0).any()
