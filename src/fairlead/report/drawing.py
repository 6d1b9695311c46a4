"""Top views: obstacles, ropes and goals seen from above, for the figures that show a scene."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon

from fairlead.report.style import GOAL, GRIPPER, OBSTACLE, ROPE


def outline(box: Mapping[str, Any]) -> Float[np.ndarray, "4 2"]:
    """Corners [m] of a box's top face, seen from above; `box` is as a scene file writes it."""
    x, y, z, w = box["quaternion_xyzw"]
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        ]
    )
    corners = np.array([[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]]) * np.array(box["size"]) / 2
    return corners @ turn.T + np.array(box["position"][:2])


def outlines(obstacles: Iterable[Mapping[str, Any]]) -> list[Float[np.ndarray, "4 2"]]:
    """Outlines of every box of a scene's obstacles."""
    return [outline(box) for obstacle in obstacles for box in obstacle["boxes"]]


def view_of(scene: Mapping[str, Any]) -> tuple[Float[np.ndarray, " 2"], float]:
    """Centre and half the side [m] of the square that shows a scene, with 0.15 m around what is in it."""
    starts = [*scene["rope"], *scene["grippers"].values(), scene["goal"]["position"]]
    seen = np.concatenate([np.array(starts)[:, :2], *outlines(scene["obstacles"])])
    low, high = seen.min(axis=0), seen.max(axis=0)
    return (low + high) / 2, float((high - low).max() / 2 + 0.15)


def draw_obstacles(axes: Axes, polygons: Iterable[Float[np.ndarray, "4 2"]]) -> None:
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


def draw_goal(axes: Axes, goal: Mapping[str, Any]) -> None:
    """The goal's circle and centre; `goal` is as a scene file writes it."""
    centre = tuple(goal["position"][:2])
    axes.add_patch(Circle(centre, goal["radius"], facecolor=GOAL, alpha=0.25, edgecolor=GOAL))
    axes.plot(*centre, "+", color=GOAL, markersize=5, markeredgewidth=1.5)


def arena(axes: Axes, half: float = 1.0) -> None:
    """A square frame without ticks."""
    axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal", xticks=[], yticks=[])
    axes.grid(False)
    for spine in axes.spines.values():
        spine.set(visible=True, color="#a9b2bd")
