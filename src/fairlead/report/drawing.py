"""Top views: obstacles, ropes and goals seen from above, for the figures that show a scene."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import product
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.patches import Circle, Polygon
from scipy.spatial import ConvexHull

from fairlead.core.marks import Mark, marks
from fairlead.report.style import GOAL, GRIPPER, OBSTACLE, ROPE


def outline(box: Mapping[str, Any]) -> Float[np.ndarray, "corner 2"]:
    """Corners [m] of a box seen from above, in order around it; `box` is as a scene file writes it."""
    x, y, z, w = box["quaternion_xyzw"]
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        ]
    )
    corners = np.array(list(product((-0.5, 0.5), repeat=3))) * box["size"] @ turn.T + box["position"][:2]
    # An upright box has each corner twice, but for rounding.
    seen = np.unique(corners.round(9), axis=0)
    return seen[ConvexHull(seen).vertices]


def outlines(obstacles: Iterable[Mapping[str, Any]]) -> list[Float[np.ndarray, "corner 2"]]:
    """Outlines of every box of a scene's obstacles."""
    return [outline(box) for obstacle in obstacles for box in obstacle["boxes"]]


def view_of(scene: Mapping[str, Any]) -> tuple[Float[np.ndarray, " 2"], float]:
    """Centre and half the side [m] of the square that shows a scene, with 0.15 m around what is in it."""
    starts = np.array([*scene["rope"], *scene["grippers"].values()])[:, :2]
    goal = [shape(mark) for mark in marks(scene["goal"])]
    seen = np.concatenate([starts, *goal, *outlines(scene["obstacles"])])
    low, high = seen.min(axis=0), seen.max(axis=0)
    return (low + high) / 2, float((high - low).max() / 2 + 0.15)


def draw_obstacles(axes: Axes, polygons: Iterable[Float[np.ndarray, "corner 2"]]) -> None:
    """Fill the outlines."""
    for polygon in polygons:
        axes.add_patch(Polygon(polygon, closed=True, facecolor=OBSTACLE, edgecolor="#a9b2bd", linewidth=0.6))


def draw_rope(
    axes: Axes, points: Float[np.ndarray, "point 3"], colour: str = ROPE, label: str | None = None, **line: Any
) -> None:
    """A rope from its tail (a dot) to its gripper (a square)."""
    axes.plot(points[:, 0], points[:, 1], color=colour, solid_capstyle="round", label=label, **line)
    axes.plot(*points[0, :2], "o", color=colour, markersize=3)
    axes.plot(*points[-1, :2], "s", color=GRIPPER, markersize=3)


def shape(mark: Mark) -> Float[np.ndarray, "corner 2"]:
    """A goal's mark seen from above: the corners of a box [m], or the one point of a place."""
    return outline(mark) if "size" in mark else np.array([mark["position"][:2]])


def draw_goal(axes: Axes, goal: Mapping[str, Any]) -> None:
    """Circles for places, outlines for boxes, dashed for one to be out of; `goal` is as a scene file writes it."""
    for mark in marks(goal):
        if "size" in mark:
            inside = mark["kind"] != "outside"
            colour, dashes = (GOAL, "-") if inside else (GRIPPER, "--")
            face = to_rgba(colour, 0.2 if inside else 0.0)
            axes.add_patch(Polygon(shape(mark), facecolor=face, edgecolor=colour, linestyle=dashes))
        else:
            centre = tuple(mark["position"][:2])
            axes.add_patch(Circle(centre, mark["radius"], facecolor=GOAL, alpha=0.25, edgecolor=GOAL))
            axes.plot(*centre, "+", color=GOAL, markersize=5, markeredgewidth=1.5)


def arena(axes: Axes, centre: Float[np.ndarray, " 2"], half: float) -> None:
    """A square frame without ticks: its centre and half its side [m]."""
    (x, y), reach = centre, np.array([-half, half])
    axes.set(xlim=x + reach, ylim=y + reach, aspect="equal", xticks=[], yticks=[])
    axes.grid(False)
    for spine in axes.spines.values():
        spine.set(visible=True, color="#a9b2bd")
