"""The parts of the page: one for each set of trials, one for what was learned, one for what the method sees."""

from __future__ import annotations

import base64
import io
import math
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

from matplotlib.figure import Figure
from PIL import Image

from fairlead.core.artifacts import write_atomic
from fairlead.core.budget import Budget
from fairlead.core.records import TrialOutcome
from fairlead.report import evidence_figures, figures, model_figures, tables
from fairlead.report.sensitivity import threshold_sensitivity
from fairlead.report.sources import Sources, TrialSet
from fairlead.report.stage import Cameras, photograph
from fairlead.report.style import OUTCOMES, method_style, to_svg
from fairlead.report.tables import Table, counted
from fairlead.report.videos import Clip

_TYPES = {".svg": "image/svg+xml", ".png": "image/png", ".gif": "image/gif", ".mp4": "video/mp4"}


@dataclass(frozen=True)
class Picture:
    """A figure on the page: where its file is, and what to say under it."""

    path: Path
    caption: str
    wide: bool = False

    @property
    def uri(self) -> str:
        """The file as a data URI."""
        content = base64.b64encode(self.path.read_bytes()).decode()
        return f"data:{_TYPES[self.path.suffix]};base64,{content}"


@dataclass
class Section:
    """One part of the page. `bars` and `matrix` are for sets of trials."""

    title: str
    lead: str = ""
    bars: list[dict[str, Any]] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)
    clips: list[Clip] = field(default_factory=list)
    matrix: dict[str, Any] | None = None


class Figures:
    """Writes figures beside the page."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "figures"

    def save(self, name: str, canvas: Figure, caption: str, wide: bool = False) -> Picture:
        """Write a figure as SVG."""
        path = self.folder / f"{name}.svg"
        write_atomic(path, to_svg(canvas))
        return Picture(path, caption, wide)

    def save_photograph(self, name: str, image: Image.Image, caption: str) -> Picture:
        """Write an image as PNG."""
        path, content = self.folder / f"{name}.png", io.BytesIO()
        image.save(content, "png")
        write_atomic(path, content.getvalue())
        return Picture(path, caption)


def bars(summary: dict[str, Any]) -> list[dict[str, Any]]:
    """One bar of success a method."""
    return [
        {
            "name": tables.named(summary, name),
            "budget": entry["budget"],
            "colour": method_style(name)[0],
            "first": entry["first_plan_success"],
            **entry["success"],
        }
        for name, entry in summary["methods"].items()
    ]


def matrix(trials: TrialSet) -> dict[str, Any]:
    """The outcome of every trial: a line a method, a column a scene and seed; None where a method was not tried."""
    columns = sorted({(row["scene"], row["seed"]) for row in trials.rows})
    cells = {}
    for name, rows in trials.rows_of.items():
        found = {(row["scene"], row["seed"]): _cell(row) for row in rows}
        cells[name] = [found.get(column) for column in columns]
    used = {row["outcome"] for row in trials.rows}
    legend = [(o.label, OUTCOMES[o.label], o.sentence) for o in TrialOutcome if o.label in used]
    return {"cells": cells, "legend": legend}


def _cell(row: dict[str, Any]) -> dict[str, str]:
    """A trial's colour, and its numbers."""
    return {
        "colour": OUTCOMES[row["outcome"]],
        "text": f"{row['scene']}, seed {row['seed']}: {TrialOutcome.of(row['outcome']).sentence} "
        f"Error {row['error_m']:.3f} m, {row['plans']} plans, {row['planning_s'] + row['execution_s']:.0f} s.",
    }


def title_of(trials: TrialSet) -> str:
    """What a set of trials is called: its scenario, and its folder where that says more."""
    scenario, name = trials.config["scenario"], trials.name
    return name if name.startswith(scenario) else f"{scenario}: {name}"


def trial_section(trials: TrialSet, save: Figures, clips: list[Clip], cameras: Cameras) -> Section:
    """Everything about one set of trials."""
    config, summary = trials.config, trials.summary
    scenes, seeds = (len({row[key] for row in trials.rows}) for key in ("scene", "seed"))
    budget = Budget.parse(config["budget"])
    other = (
        f" Executed in another world than that of training: {config['differences']}."
        if config.get("differences")
        else ""
    )
    other += " Actions that were cut short were remembered within a trial." if config.get("remember") else ""
    other += " The learned dynamics were the distilled ones." if config.get("distilled") else ""
    other += "" if trials.scenes else " The scenes themselves are not here, so there are no pictures of them."
    timed = math.isfinite(budget.seconds)
    clock = "" if timed else " A counted budget does not look at the clock: times are those of execution alone."
    unfinished = "" if len(tables.whole(summary)) == len(summary["methods"]) else ", those with fewer trials on a part"
    section = Section(
        title=title_of(trials),
        lead=f"{counted(scenes, 'scene')} of {config['scenes']}.json, {counted(seeds, 'seed')}; every method on the "
        f"same scenes, starts, goals and seeds{unfinished}. Budget {budget} a trial, protocol “{config['protocol']}”, "
        f"{config['planner']} planner.{other}{clock}{_laid(trials)}",
        bars=bars(summary),
        tables=[tables.success_table(summary, str(budget)), tables.error_table(summary, config["scenario"])],
        matrix=matrix(trials),
        clips=clips,
    )
    if summary["comparisons"]:
        section.tables.append(tables.comparison_table(summary))
    section.tables += [tables.effort_table(summary), tables.actions_table(summary)]
    section.pictures += _trial_pictures(trials, save, budget.seconds, cameras)
    return section


def _laid(trials: TrialSet) -> str:
    """How far from the scenes' points the ropes came to rest before the trials; earlier rows do not tell."""
    gaps = [1000 * row["start_residual_m"] for row in trials.rows if "start_residual_m" in row]
    if not gaps:
        return ""
    return (
        f" Ropes came to rest {median(gaps):.1f} mm (median, at most {max(gaps):.1f}) from where they are laid, "
        "root mean square over the points."
    )


def _trial_pictures(trials: TrialSet, save: Figures, seconds: float, cameras: Cameras) -> list[Picture]:
    """The first scene through the camera, if there is one, and the figures; `seconds` is the budget of a trial [s]."""
    name, radius = trials.name, 0.0
    found: list[Picture] = []
    for first in trials.scenes[:1]:
        radius, image = first["goal"].get("radius", 0.0), photograph(trials.config, first, cameras)
        caption = f"Scene {first['name']} at its start, and its goal."
        found = [] if image is None else [save.save_photograph(f"{name}-scene", image, caption)]
    longest = max((row["reached_at_s"] or 0.0 for row in trials.rows), default=0.0)
    horizon = seconds if math.isfinite(seconds) else max(1.0, longest)
    found += [
        save.save(
            f"{name}-threshold",
            figures.success_against_threshold(trials.rows_of, radius),
            "Success against the threshold on the task error (Fig. 6). Dashed: the goal's tolerance.",
        ),
        save.save(
            f"{name}-time",
            figures.success_against_time(trials.rows_of, horizon),
            "Success against the time of a trial: planning plus simulated execution.",
        ),
        save.save(f"{name}-outcomes", figures.outcomes(trials.summary), "How the trials ended."),
        save.save(f"{name}-spent", figures.time_spent(trials.summary), "Where the time of a trial goes."),
    ]
    if trials.scenes:
        caption = f"The scenes: start, goal (green), and as frame the outcome of the first trial of {trials.reference}."
        gallery = figures.gallery(trials.scenes, trials.rows_of[trials.reference])
        found.append(save.save(f"{name}-scenes", gallery, caption, wide=True))
    return found


def overview_section(sources: Sources) -> Section | None:
    """Several sets of trials at a glance."""
    if len(sources.trials) < 2:
        return None
    table = tables.overview_table({title_of(trials): trials.summary for trials in sources.trials})
    return Section(
        "Overview", f"{len(sources.trials)} sets of trials; each has a part of its own below.", tables=[table]
    )


def learning_section(sources: Sources, save: Figures) -> Section | None:
    """Every model that was trained; None where there is none."""
    models = [model for model in sources.models if model.metrics]
    if not models:
        return None
    section = Section(
        "Learning", "Numbers without another word are of test data, which no training, threshold or choice has seen."
    )
    section.tables += model_figures.metrics_tables(models)
    section.pictures += [save.save(f"model-{n}", *figure) for n, figure in enumerate(model_figures.pictures(models))]
    return section


def evidence_section(sources: Sources, save: Figures) -> Section | None:
    """Single examples; None where there are none."""
    drawn = [figure for folder in sources.evidence for figure in evidence_figures.pictures(folder)]
    if not drawn:
        return None
    section = Section("What the method sees", "Drawn from recorded data and the trained models.")
    section.pictures += [save.save(f"evidence-{n}", *figure) for n, figure in enumerate(drawn)]
    return section


def sensitivity_section(folder: Path, number: int, save: Figures) -> Section:
    """Trust at one threshold after another (Fig. S2)."""
    title, table, canvas = threshold_sensitivity(folder)
    caption = "Threshold sensitivity (Fig. S2): a classifier for each δ. Dashed: the δ of the dynamics."
    lead = "A classifier for each δ, trained alike and tried on the same random scenes, which are drawn for this alone."
    return Section(title, lead, tables=[table], pictures=[save.save(f"sensitivity-{number}", canvas, caption)])
