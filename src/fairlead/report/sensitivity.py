"""Threshold sensitivity (paper, Fig. S2): what becomes of a classifier and its trials as delta changes."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from fairlead.core.artifacts import read_json, read_manifest
from fairlead.report.style import MUTED, figure
from fairlead.report.tables import Table, percent, rate

_CURVES = (
    ("success", "success", "#0072b2", "-"),
    ("first_plan_success", "first plan alone", "#0072b2", "--"),
    ("accepted_share", "examples accepted", "#d55e00", "-"),
    ("reliable_share", "examples reliable", "#d55e00", ":"),
)


def threshold_sensitivity(folder: Path) -> tuple[str, Table, Figure]:
    """A title, the numbers of each delta, and their figure with bands of 95 % Wilson intervals."""
    about, rows = read_manifest(folder, "sensitivity"), read_json(folder / "sensitivity.json")
    with figure(6.4, 3.3) as (canvas, (axes,)):
        deltas = [row["delta_m"] for row in rows]
        for key, label, colour, dashes in _CURVES:
            values = [row[key] for row in rows]
            if isinstance(values[0], dict):
                low, values, high = ([100 * of[end] for of in values] for end in ("low", "value", "high"))
                axes.fill_between(deltas, low, high, color=colour, alpha=0.1, linewidth=0)
            else:
                values = [100 * value for value in values]
            axes.plot(deltas, values, color=colour, linestyle=dashes, marker="o", markersize=3, label=label)
        axes.axvline(about.extra["own_delta_m"], color=MUTED, linestyle=(0, (4, 3)), linewidth=1)
        axes.set(ylim=(0, 103), xlabel="δ [m]", ylabel="%")
        canvas.legend(loc="outside right upper", handlelength=3.5)
    columns = ("δ [m]", "success", "first plan alone", "mean error [m]", "stuck trials", "examples", "reliable",
               "accepted", "accuracy")  # fmt: skip
    lines = [
        (
            f"{row['delta_m']:g}",
            rate(row["success"]),
            rate(row["first_plan_success"]),
            f"{row['mean_error_m']:.3f}",
            f"{row['stuck_trials']} of {row['trials']}",
            f"{row['examples']:,}",
            *(percent(row[key]) for key in ("reliable_share", "accepted_share", "accuracy")),
        )
        for row in rows
    ]
    note = f"Budget {about.config['budget']} a trial. Examples, and what is said of them, are of test data."
    title = f"{about.config['scenario']}: threshold sensitivity, {about.config['method']}"
    return title, Table("By threshold", columns, tuple(lines), note), canvas
