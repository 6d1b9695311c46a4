"""Figures of a set of trials: success against threshold and time, where time goes, outcomes, the scenes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fairlead.report.drawing import arena, draw_goal, draw_obstacles, draw_rope, outlines, view_of
from fairlead.report.style import INK, MUTED, OUTCOMES, figure, method_style
from fairlead.report.tables import among, named

Row = Mapping[str, Any]
RowsOf = Mapping[str, Sequence[Row]]
"""Method -> its trials, in the order of the report."""


def _share_below(axes: Axes, rows_of: RowsOf, key: str, limits: np.ndarray) -> None:
    """For each method, the share of trials whose `key` is at most each limit (null: never)."""
    most = max(map(len, rows_of.values()))
    for name, rows in rows_of.items():
        values = np.sort([np.inf if row[key] is None else row[key] for row in rows])
        colour, dashes = method_style(name)
        share = 100 * np.searchsorted(values, limits, side="right") / len(values)
        axes.plot(limits, share, color=colour, linestyle=dashes, label=among(name, len(rows), most))
    axes.set(ylim=(0, 103), xlim=(limits[0], limits[-1]), ylabel="success [%]")


def success_against_threshold(rows_of: RowsOf, radius: float) -> Figure:
    """Fig. 6: the success rate if the goal's tolerance [m] were another; the dashed line is the one used."""
    with figure(6.4, 3.3) as (canvas, (axes,)):
        _share_below(axes, rows_of, "error_m", np.linspace(0, 0.5, 501))
        axes.axvline(radius, color=MUTED, linestyle=(0, (4, 3)), linewidth=1)
        axes.set(xlabel="threshold on the task error [m]")
        canvas.legend(loc="outside right upper")
    return canvas


def success_against_time(rows_of: RowsOf, seconds: float) -> Figure:
    """The success rate if a trial were given less time: planning plus simulated execution [s]."""
    with figure(6.4, 3.3) as (canvas, (axes,)):
        _share_below(axes, rows_of, "reached_at_s", np.linspace(0, seconds, 601))
        axes.set(xlabel="time of a trial [s]")
        canvas.legend(loc="outside right upper")
    return canvas


def time_spent(summary: Mapping[str, Any]) -> Figure:
    """Mean seconds of planning and of execution in a trial, for each method."""
    methods = list(summary["methods"])
    with figure(5.6, 1.0 + 0.32 * len(methods)) as (canvas, (axes,)):
        left, names = np.zeros(len(methods)), [named(summary, name) for name in methods]
        for key, label, alpha in (("mean_planning_s", "planning", 1.0), ("mean_execution_s", "execution", 0.35)):
            width = np.array([summary["methods"][name][key] for name in methods])
            colours = [method_style(name)[0] for name in methods]
            axes.barh(names, width, left=left, color=colours, alpha=alpha, height=0.62)
            axes.barh([names[0]], [0], color=INK, alpha=alpha, label=label)
            left += width
        for row, total in enumerate(left):
            axes.text(total, row, f"  {total:.1f} s", va="center", fontsize=9, color=MUTED)
        axes.invert_yaxis()
        axes.margins(x=0.12)
        axes.grid(axis="y", visible=False)
        axes.tick_params(axis="y", length=0, labelcolor=INK)
        axes.set(xlabel="mean time of a trial [s]")
        canvas.legend(loc="outside upper center", ncols=2)
    return canvas


def outcomes(summary: Mapping[str, Any]) -> Figure:
    """How the trials of each method ended, in percent."""
    methods = list(summary["methods"])
    found = [key for key in OUTCOMES if any(summary["methods"][name]["outcomes"].get(key) for name in methods)]
    with figure(5.6, 1.0 + 0.32 * len(methods)) as (canvas, (axes,)):
        left, labels = np.zeros(len(methods)), [named(summary, name) for name in methods]
        for key in found:
            entries = [summary["methods"][name] for name in methods]
            share = np.array([100 * entry["outcomes"].get(key, 0) / entry["trials"] for entry in entries])
            axes.barh(labels, share, left=left, color=OUTCOMES[key], height=0.62, label=key)
            for row in np.flatnonzero(share >= 7):
                text = {"x": left[row] + share[row] / 2, "y": row, "s": f"{share[row]:.0f}"}
                axes.text(**text, ha="center", va="center", fontsize=8.5, color="white")
            left += share
        axes.invert_yaxis()
        axes.grid(axis="y", visible=False)
        axes.tick_params(axis="y", length=0, labelcolor=INK)
        axes.set(xlim=(0, 100), xlabel="trials [%]")
        canvas.legend(loc="outside upper center", ncols=len(found))
    return canvas


def gallery(scenes: Sequence[Mapping[str, Any]], rows: Iterable[Row], columns: int = 10) -> Figure:
    """Every scene from above: start, goal, and as frame the outcome of one method's first trial there."""
    outcome = {row["scene"]: row["outcome"] for row in sorted(rows, key=lambda row: -row["seed"])}
    count = -(-len(scenes) // columns)
    with figure(10.5, 1.12 * count, count, columns) as (canvas, grid):
        for axes in grid[len(scenes) :]:
            axes.remove()
        for axes, scene in zip(grid, scenes, strict=False):
            arena(axes, *view_of(scene))
            draw_obstacles(axes, outlines(scene["obstacles"]))
            draw_goal(axes, scene["goal"])
            draw_rope(axes, np.array(scene["rope"] or list(scene["grippers"].values())), linewidth=1.4)
            axes.set_title(scene["name"], fontsize=6, fontweight="normal", color=MUTED, pad=2)
            if scene["name"] in outcome:
                for spine in axes.spines.values():
                    spine.set(color=OUTCOMES[outcome[scene["name"]]], linewidth=1.6)
    return canvas
