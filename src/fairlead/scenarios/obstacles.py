"""Movable obstacles: mocap bodies of one compiled model, so that their poses are fields of each simulation's state."""

# pyright: reportAttributeAccessIssue=false
# MuJoCo ships no type stubs.

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import mujoco
import mujoco.batch
import numpy as np
from jaxtyping import Float

from fairlead.core.errors import FairleadError, SamplingError
from fairlead.geometry.shapes import Box, Obstacle, box_distance
from fairlead.scenarios.rope import OBSTACLE_BIT

Sizes = tuple[tuple[float, ...], ...]


def box_sizes(obstacles: Sequence[Obstacle]) -> Sizes:
    """Side lengths of every box in order: what a compiled model depends on."""
    return tuple(box.size for obstacle in obstacles for box in obstacle.boxes)


def add_boxes(spec: mujoco.MjSpec, sizes: Sizes, friction: float) -> None:
    """Add one mocap body for each box, far below the floor until it is placed."""
    for i, size in enumerate(sizes):
        body = spec.worldbody.add_body(name=f"obstacle{i}", mocap=True, pos=[0, 0, -10.0 - i])
        body.add_geom(
            name=f"obstacle{i}", type=mujoco.mjtGeom.mjGEOM_BOX, size=np.array(size) / 2,
            contype=OBSTACLE_BIT, conaffinity=0, friction=[friction, 0, 0],
        )  # fmt: skip


def place_boxes(batch: mujoco.batch.Batch, obstacles: Sequence[Sequence[Obstacle]]) -> None:
    """Move the boxes, the last mocap bodies of a model, to where each row has them.

    Raises:
        FairleadError: rows with boxes of different sizes.
    """
    sizes = box_sizes(obstacles[0])
    if any(box_sizes(row) != sizes for row in obstacles):
        raise FairleadError("all scenes simulated together must have boxes of the same sizes in the same order")
    if sizes:
        boxes = [[box for obstacle in row for box in obstacle.boxes] for row in obstacles]
        batch.mocap_pos[:, -len(sizes) :] = [[box.position for box in row] for row in boxes]
        batch.mocap_quat[:, -len(sizes) :] = [[np.roll(box.quaternion_xyzw, 1) for box in row] for row in boxes]


def place_apart(
    shapes: Sequence[Obstacle],
    low: float,
    high: float,
    keep_clear: Float[np.ndarray, "point 3"],
    clearance: float,
    rng: np.random.Generator,
    walls: Sequence[Box] = (),
    tries: int = 4000,
) -> tuple[Obstacle, ...]:
    """Place shapes on the floor at random, apart from each other, inside `walls` and clear of points.

    Yaw is a quarter turn, in half of the cases with a deviation of 8 degrees (standard deviation), as in the
    authors' scenes.

    Args:
        shapes: obstacles at the origin.
        low, high: range of their x and y [m].
        keep_clear: points that must be at least `clearance` [m] outside of every obstacle.
        rng: random stream.
        walls: boxes that obstacles must not overlap.
        tries: attempts before giving up.

    Raises:
        SamplingError: no free place was found.
    """
    placed: list[Obstacle] = []
    for attempt in range(tries):
        if len(placed) == len(shapes):
            break
        if attempt % 400 == 399:  # an early placement can leave no room for the last obstacle
            placed.clear()
        yaw = rng.integers(4) * np.pi / 2 + rng.normal(0, np.radians(8)) * (rng.random() < 0.5)
        shape = shapes[len(placed)]
        moved = shape.moved((*rng.uniform(low, high, 2), shape.boxes[0].size[2] / 2), float(yaw))
        others = [box for obstacle in placed for box in obstacle.boxes] + list(walls)
        if box_distance(moved.boxes, keep_clear).min(initial=np.inf) > clearance and not _overlap(moved.boxes, others):
            placed.append(moved)
    if len(placed) < len(shapes):
        raise SamplingError("free place for the obstacles", tries, "use fewer or smaller obstacles, or a larger arena")
    return tuple(placed)


def _overlap(boxes: Sequence[Box], others: Sequence[Box]) -> bool:
    """Whether the outlines of upright boxes overlap, tested on points along their sides."""
    if not others:
        return False
    return bool(box_distance(others, _outline(boxes)).min() < 0 or box_distance(boxes, _outline(others)).min() < 0)


def _outline(boxes: Sequence[Box]) -> Float[np.ndarray, "point 3"]:
    """Points at most 2 cm apart along the horizontal outlines of boxes, at the height of the lowest centre."""
    points = []
    for box in boxes:
        corners = box.corners()[[0, 2, 6, 4]]
        ring = np.concatenate([corners, corners[:1]])
        fractions = np.linspace(0, 1, int(max(box.size) / 0.02) + 2)[:, None]
        points += [a + fractions * (b - a) for a, b in pairwise(ring)]
    stacked = np.concatenate(points)
    stacked[:, 2] = 0.02
    return stacked
