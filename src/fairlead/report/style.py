"""One look for every figure, table and video: colours that colour-blind readers can tell apart, light axes."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

INK, MUTED, FAINT, PAPER = "#1d2733", "#667383", "#dfe4ea", "#ffffff"
OBSTACLE, GOAL, ROPE, GHOST, GRIPPER = "#c3cad3", "#009e73", "#1d2733", "#e69f00", "#cc3311"
FONTS = "-apple-system, 'Segoe UI', 'Helvetica Neue', Arial, 'DejaVu Sans', sans-serif"

_METHODS = {
    "trust": ("#0072b2", "-"),
    "trust+recovery": ("#0072b2", "--"),
    "trust+random-recovery": ("#0072b2", ":"),
    "trust-sdf": ("#009e73", "-"),
    "trust-sdf+recovery": ("#009e73", "--"),
    "trust-sdf+random-recovery": ("#009e73", ":"),
    "accept-all": ("#d55e00", "-"),
    "accept-all+arms": ("#d55e00", "--"),
    "full-dynamics": ("#cc79a7", "-"),
    "full-dynamics+arms": ("#cc79a7", "--"),
    "collision-check": ("#b8860b", "-"),
    "collision-check+random-recovery": ("#b8860b", ":"),
    "spread-threshold": ("#7b5ea7", "-"),
    "spread-threshold+arms": ("#7b5ea7", "--"),
    "oracle": ("#667383", "--"),
}
_OTHERS = ("#56b4e9", "#882255", "#44aa99", "#aa4499")

OUTCOMES = {
    "goal": "#0072b2",
    "budget": "#e69f00",
    "stuck": "#cc79a7",
    "diverged": "#1d2733",
    "interrupted": "#aab4bf",
}
"""Outcome of a trial -> colour; the labels are those of core.records.TrialOutcome."""

_RC: dict[Any, Any] = {
    "font.size": 10,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": MUTED,
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "axes.titlecolor": INK,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#eef1f4",
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "lines.linewidth": 2.0,
    "svg.fonttype": "none",
    "svg.hashsalt": "fairlead",
}


def method_style(name: str) -> tuple[str, str]:
    """Colour and line style of a method, the same in every figure; a stranger's gets a colour by its name."""
    return _METHODS.get(name, (_OTHERS[sum(name.encode()) % len(_OTHERS)], "-."))


@contextmanager
def figure(width: float, height: float, rows: int = 1, columns: int = 1) -> Iterator[tuple[Figure, list[Axes]]]:
    """A figure of that size [inch] with its axes in reading order, drawn in the house style."""
    with mpl.rc_context(_RC):
        canvas = Figure(figsize=(width, height), layout="constrained")
        yield canvas, list(canvas.subplots(rows, columns, squeeze=False).flat)


def to_svg(canvas: Figure) -> str:
    """The figure as SVG: the same text for the same figure, letters left as letters."""
    buffer = io.StringIO()
    with mpl.rc_context(_RC):
        canvas.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
    return buffer.getvalue().replace("'DejaVu Sans'", FONTS)
