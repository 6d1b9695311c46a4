from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fairlead.geometry.capsules import BoxRows, Capsules
from fairlead.geometry.shapes import Box, box_distance


@given(st.integers(0, 2**32 - 1))
def test_clearance_is_the_least_distance_between_points(seed: int) -> None:
    """Capsules of two groups among boxes, against points sampled along the segments."""
    rng = np.random.default_rng(seed)
    starts, along, radii = rng.normal(0, 0.5, (3, 5, 2)), rng.normal(0, 0.4, (3, 5, 2)), rng.uniform(0.01, 0.1, 5)
    along[:, 0] = 0.0
    groups = np.array([0, 0, 1, 1, 1])
    rows = [
        [Box(tuple(rng.uniform(0.1, 0.5, 3)), tuple(rng.normal(0, 0.6, 3)),
             tuple(Rotation.random(random_state=rng).as_quat())) for _ in range(count)]
        for count in (3, 1)
    ]  # fmt: skip
    found = Capsules(starts, along, radii, groups).clearance(BoxRows.of(rows), 10.0)
    t = np.linspace(0, 1, 401)
    points = starts[..., None] + t * along[..., None]
    for row in range(2):
        mine = np.moveaxis(points[:, :, row], 0, -1)
        to_boxes = (box_distance(rows[row], mine).min(axis=1) - radii).min()
        between = [
            np.linalg.norm(mine[i][:, None] - mine[j], axis=-1).min() - radii[i] - radii[j]
            for i in range(5) for j in range(5) if groups[i] < groups[j]
        ]  # fmt: skip
        assert found[row] == pytest.approx(min(to_boxes, *between), abs=3e-3)
        assert found[row] <= min(to_boxes, *between) + 5e-4
    nearest = Capsules(starts, along, radii, groups).clearance(BoxRows.of(rows), 0.05)
    np.testing.assert_array_equal(nearest, np.minimum(found, 0.05))
