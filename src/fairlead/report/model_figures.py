"""What the models learned: metrics, learning curves, and how far a classifier's probabilities can be believed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from fairlead.report.paper import LEARNING
from fairlead.report.sources import Model
from fairlead.report.style import MUTED, figure, method_style
from fairlead.report.tables import Table, metrics_table, percent

Drawn = tuple[Figure, str, bool]


_LABELS = ("0", "below 1/2", "1/2 and above", "1")


def metrics_tables(models: Sequence[Model]) -> list[Table]:
    """One table a scenario of the paper, beside its numbers; then one a kind of model, with all that was measured."""
    kinds = dict.fromkeys(model.kind for model in models)
    of = {kind: [model for model in models if model.kind == kind] for kind in kinds}
    scenarios = dict.fromkeys(model.config.get("scenario") for model in models)
    beside = [
        learning_table(name, [model for model in models if model.config.get("scenario") == name])
        for name in scenarios
        if name in LEARNING
    ]
    return beside + [
        recovery_table(found)
        if kind == "recovery"
        else metrics_table(kind, {model.name: model.scalars for model in found})
        for kind, found in of.items()
    ]


REPORTED = {
    "dynamics": {"test_point_error_m": "error per point [m]", "delta_m": "δ [m]"},
    "distilled": {
        "test_point_difference_m": "from the ensemble, per point [m]",
        "test_spread_factor": "spread, factor",
    },
    "trust": {
        "accuracy": "accuracy",
        "precision": "precision",
        "recall": "recall",
        "auroc": "AUROC",
        "delta_m": "δ [m]",
    },
    "recovery": {"log_loss": "cross-entropy"},
    "full-dynamics": {"test_point_error_m": "error per point [m]"},
}


def learning_table(scenario: str, models: Sequence[Model]) -> Table:
    """What the paper reports of its models, ours beside it; and what classifiers were labelled with."""
    rows = []
    for model in models:
        for key, text in REPORTED[model.kind].items():
            ours, paper = model.scalars.get(key), LEARNING[scenario].get((model.kind, key))
            rows.append((f"{model.name}: {text}", *("-" if v is None else f"{v:.4g}" for v in (ours, paper))))
        for rule, counts in model.metrics.get("rules", {}).items():
            text = f"{counts['examples']:,}, {percent(counts['reliable'])} reliable"
            rows.append((f"{model.name}: training examples by the rule of the {rule}", text, "-"))
    note = (
        "The paper's classifier and recovery see voxels, as trust and recovery here; -sdf see signed distances. Where"
        " arms carry the object, actions that an arm cut short are no examples here: planning asks the arms."
    )
    return Table(f"{scenario}, beside the paper", ("model", "here", "paper"), tuple(rows), note)


def recovery_table(models: Sequence[Model]) -> Table:
    """How many stuck states recovery was learned from, and how their labels are distributed."""
    rows, notes = [], []
    for model in models:
        for split in ("train", "validation", "test"):
            found = model.metrics[split]
            labels = found.get("labels", {})
            loss = f"{found['log_loss']:.3f}" if "log_loss" in found else "-"
            counts = (f"{found[key]:,}" for key in ("examined", "stuck"))
            rows.append((f"{model.name}, {split}", *counts, *(str(labels.get(name, "-")) for name in _LABELS), loss))
        if not model.metrics["trained"]:
            few = " and ".join(
                f"{model.metrics[split]['stuck']:,} stuck states in {model.metrics[split]['examined']:,} ({split})"
                for split in ("train", "validation")
            )
            notes.append(
                f"{model.name} was NOT trained and acts at random: {few} transitions are too few to learn from."
            )
    note = (
        "Label: the share of random actions that is accepted after the transition; of -sdf, whose labels are"
        " discounted, also what later states of the trajectory are worth. Cross-entropies compare among equal labels."
    )
    columns = ("model, split", "examined", "stuck", *(f"label {name}" for name in _LABELS), "cross-entropy")
    return Table("recovery", columns, tuple(rows), " ".join([*notes, note]))


def learning_curves(models: Sequence[Model]) -> Drawn:
    """Training loss and validation score of each model, epoch by epoch."""
    with figure(10.5, 2.5 * -(-len(models) // 3), -(-len(models) // 3), min(3, len(models))) as (canvas, grid):
        for axes in grid[len(models) :]:
            axes.remove()
        for axes, model in zip(grid, models, strict=False):
            for key, colour in (("loss", MUTED), ("score", "#0072b2")):
                axes.semilogy([row[key] for row in model.curves], color=colour, label=key, linewidth=1.5)
            axes.set(title=model.name, xlabel="epoch")
        grid[0].legend()
    return (
        canvas,
        "Learning curves: training loss, and the validation score by which the kept weights were chosen.",
        True,
    )


def reliability(models: Sequence[Model]) -> Drawn:
    """Reliability diagrams: how often transitions were reliable, against the probability that was predicted."""
    with figure(5.6, 3.5) as (canvas, (axes,)):
        axes.plot([0, 1], [0, 1], color=MUTED, linewidth=1, linestyle=(0, (4, 3)))
        for model in models:
            bins = model.metrics["test"]["reliability"]
            predicted, observed, count = (
                np.array([b[key] for b in bins]) for key in ("predicted", "observed", "count")
            )
            colour, dashes = method_style(model.name)
            axes.plot(predicted, observed, color=colour, linestyle=dashes, label=model.name)
            axes.scatter(predicted, observed, s=8 + 160 * count / count.sum(), color=colour, zorder=3)
        axes.set(xlim=(-0.02, 1.02), ylim=(-0.02, 1.02), xlabel="predicted probability", ylabel="share reliable")
        axes.legend(loc="upper left")
    return canvas, "Reliability on test data; the area of a dot is the share of examples. Dashed: perfect.", False


def pictures(models: Sequence[Model]) -> list[Drawn]:
    """Every figure that the models have data for."""
    drawn = []
    if judged := [model for model in models if model.kind == "trust"]:
        drawn.append(reliability(judged))
    if learned := [model for model in models if model.curves]:
        drawn.append(learning_curves(learned))
    return drawn
