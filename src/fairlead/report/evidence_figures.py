"""Drawings of single examples: Fig. 3 (labels of a trajectory), Fig. 5 (voxels), Fig. S1 (accepted contacts)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from fairlead.core.artifacts import read_manifest
from fairlead.report.drawing import arena, draw_obstacles, draw_rope, outline
from fairlead.report.style import GHOST, GRIPPER, MUTED, ROPE, figure

Arrays = Mapping[str, Any]
Drawn = tuple[Figure, str, bool]
"""A figure, its caption, and whether it takes the page's whole width."""

_LABELS = {1: ("1: reliable", "#0072b2"), 0: ("0: not reliable", "#d55e00"), -1: ("discarded", "#8b97a5")}


def _boxes(axes: Axes, boxes: np.ndarray) -> None:
    """Obstacles as rows of size, position and quaternion (10 numbers)."""
    fields = ({"size": b[:3], "position": b[3:6], "quaternion_xyzw": b[6:]} for b in boxes if b[0] > 0)
    draw_obstacles(axes, [outline(box) for box in fields])


def _zoom(axes: Axes, points: np.ndarray, margin: float) -> None:
    """A square window [m] about the points."""
    low, high = points.reshape(-1, 3)[:, :2].min(axis=0), points.reshape(-1, 3)[:, :2].max(axis=0)
    centre, half = (low + high) / 2, (high - low).max() / 2 + margin
    arena(axes, centre, float(half))


def labelled_trajectory(data: Arrays) -> Drawn:
    """Fig. 3 from a recorded trajectory: predicted against actual, and the label of each transition."""
    actual, predicted, labels = data["actual"], data["predicted"], data["labels"]
    count = len(labels)
    with figure(10.5, 10.5 / count + 0.55, 1, count) as (canvas, grid):
        for t, axes in enumerate(grid):
            _zoom(axes, np.concatenate([actual, predicted]), 0.06)
            _boxes(axes, data["boxes"])
            draw_rope(axes, actual[t], MUTED, linewidth=1.0, alpha=0.5)
            draw_rope(axes, predicted[t + 1], GHOST, linewidth=4.5, alpha=0.8)
            draw_rope(axes, actual[t + 1], ROPE, linewidth=1.6)
            text, colour = _LABELS[int(labels[t])]
            axes.set_title(f"{text}\nd = {data['distance'][t + 1]:.3f} m", color=colour, fontsize=8)
            for spine in axes.spines.values():
                spine.set(color=colour, linewidth=1.6)
    caption = (
        "Fig. 3, from a recorded trajectory. Black: what happened; orange: the model's rollout; grey: before. A "
        f"transition is an example while its first states are closer than δ = {float(data['delta']):.3f} m; it is "
        "labelled 1 if its second states are, too."
    )
    return canvas, caption, True


def voxels(data: Arrays) -> Drawn:
    """Fig. 5: the channels of the local voxel grid, seen from above, their values as opacity."""
    channels = data["channels"].max(axis=-1)
    colours = ["#8b97a5", "#0072b2", GRIPPER, "#009e73"]
    names = [str(name) for name in data["names"]]
    half_x, half_y = (data["resolution"] * size / 2 for size in channels.shape[1:])
    picture = np.ones((*channels.shape[1:], 3))
    for channel, colour in zip(channels, colours, strict=False):
        picture += channel[..., None] * (np.array(to_rgb(colour)) - picture)
    panels = [("all channels", picture)]
    for name, channel, colour in zip(names, channels, colours, strict=False):
        panels.append((name, 1 + channel[..., None] * (np.array(to_rgb(colour)) - 1)))
    with figure(10.5, 10.5 / len(panels) + 0.35, 1, len(panels)) as (canvas, grid):
        for axes, (name, pixels) in zip(grid, panels, strict=True):
            extent = (-half_x, half_x, -half_y, half_y)
            axes.imshow(
                np.clip(pixels, 0, 1).transpose(1, 0, 2), origin="lower", extent=extent, interpolation="nearest"
            )
            axes.grid(False)
            axes.set(title=name, xticks=[-half_x, 0, half_x], yticks=[-half_y, 0, half_y])
    shape = " x ".join(map(str, data["channels"].shape[1:]))
    caption = (
        f"Fig. 5: the local voxel grid of one state, {shape} cells of {float(data['resolution']):g} m, from above."
    )
    return canvas, caption, True


def contacts(data: Arrays) -> Drawn:
    """Fig. S1: transitions in contact with an obstacle that the classifier accepts."""
    count = len(data["before"])
    columns = min(6, count)
    rows = -(-count // columns)
    with figure(10.5, rows * (10.5 / columns + 0.2), rows, columns) as (canvas, grid):
        for axes in grid[count:]:
            axes.remove()
        for i, axes in enumerate(grid[:count]):
            before, after = data["before"][i], data["after"][i]
            _zoom(axes, np.concatenate([before, after]), 0.08)
            _boxes(axes, data["boxes"][i])
            draw_rope(axes, before, MUTED, linewidth=1.2, alpha=0.6)
            draw_rope(axes, data["predicted"][i], GHOST, linewidth=4.5, alpha=0.8)
            draw_rope(axes, after, ROPE, linewidth=1.6)
            axes.set_title(f"trust {data['probability'][i]:.2f}", fontsize=8, fontweight="normal")
    caption = (
        "Fig. S1: examples of contact that the classifier accepts, rightly. Grey: before; black: after, as it "
        "happened; orange: predicted."
    )
    return canvas, caption, True


_DRAWERS = {"trajectory": labelled_trajectory, "voxels": voxels, "contacts": contacts}


def pictures(folder: Path) -> list[Drawn]:
    """Every drawing that an evidence folder has data for."""
    listed = read_manifest(folder, "evidence").files
    drawn = []
    for name, draw in _DRAWERS.items():
        if f"{name}.npz" in listed:
            with np.load(folder / f"{name}.npz", allow_pickle=False) as data:
                drawn.append(draw(dict(data)))
    return drawn
