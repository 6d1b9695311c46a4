"""The page: one HTML file that needs nothing beside it, and the same tables as Markdown."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jinja2
from matplotlib.figure import Figure

from fairlead.core.artifacts import MANIFEST, Manifest, read_manifest, sha256, write_atomic
from fairlead.core.budget import Budget
from fairlead.core.records import TrialOutcome
from fairlead.report import evidence_figures, figures, model_figures, tables
from fairlead.report.provenance import provenance_table
from fairlead.report.sensitivity import threshold_sensitivity
from fairlead.report.sources import Sources, TrialSet, find_sources
from fairlead.report.stage import Cameras, no_camera
from fairlead.report.style import OUTCOMES, method_style, to_svg
from fairlead.report.tables import Table, counted
from fairlead.report.videos import Clip, make_videos

PAGE, TABLES = "report.html", "report.md"
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
class _Section:
    """One part of the page. `bars` and `matrix` are for sets of trials."""

    title: str
    lead: str = ""
    bars: list[dict[str, Any]] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)
    clips: list[Clip] = field(default_factory=list)
    matrix: dict[str, Any] | None = None


class _Figures:
    """Writes figures beside the page."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "figures"

    def save(self, name: str, canvas: Figure, caption: str, wide: bool = False) -> Picture:
        """Write a figure as SVG."""
        path = self.folder / f"{name}.svg"
        write_atomic(path, to_svg(canvas))
        return Picture(path, caption, wide)


def _bars(summary: dict[str, Any]) -> list[dict[str, Any]]:
    return [
        {
            "name": name,
            "budget": entry["budget"],
            "colour": method_style(name)[0],
            "first": entry["first_plan_success"],
            **entry["success"],
        }
        for name, entry in summary["methods"].items()
    ]


def _matrix(trials: TrialSet) -> dict[str, Any]:
    """The outcome of every trial: a line a method, a cell a trial."""
    cells = {
        name: [
            {
                "colour": OUTCOMES[row["outcome"]],
                "text": f"{row['scene']}, seed {row['seed']}: {TrialOutcome.of(row['outcome']).sentence} "
                f"Error {row['error_m']:.3f} m, {row['plans']} plans, {row['planning_s'] + row['execution_s']:.0f} s.",
            }
            for row in rows
        ]
        for name, rows in trials.rows_of.items()
    }
    used = {row["outcome"] for row in trials.rows}
    legend = [(o.label, OUTCOMES[o.label], o.sentence) for o in TrialOutcome if o.label in used]
    return {"cells": cells, "legend": legend}


def _trial_section(trials: TrialSet, save: _Figures, name: str, clips: list[Clip]) -> _Section:
    config, summary = trials.config, trials.summary
    scenes, seeds = len(trials.scenes), len({row["seed"] for row in trials.rows})
    budget = Budget.parse(config["budget"])
    timed = math.isfinite(budget.seconds)
    other = (
        f" Executed in another world than that of training: {config['differences']}."
        if config.get("differences")
        else ""
    )
    clock = "" if timed else " A counted budget does not look at the clock: times are those of execution alone."
    section = _Section(
        title=config["scenario"] if name == config["scenario"] else f"{config['scenario']}: {name}",
        lead=f"{counted(scenes, 'scene')} of {config['scenes']}.json, {counted(seeds, 'seed')}; every method on the "
        f"same scenes, starts, goals and seeds. Budget {budget} a trial, protocol “{config['protocol']}”, "
        f"{config['planner']} planner.{other}{clock}",
        bars=_bars(summary),
        tables=[tables.success_table(summary, str(budget)), tables.error_table(summary, config["scenario"])],
        matrix=_matrix(trials),
        clips=clips,
    )
    if summary["comparisons"]:
        section.tables.append(tables.comparison_table(summary))
    section.tables += [tables.effort_table(summary), tables.actions_table(summary)]
    radius = trials.scenes[0]["goal"].get("radius", 0.0)
    longest = max((row["reached_at_s"] or 0.0 for row in trials.rows), default=0.0)
    horizon = budget.seconds if timed else max(1.0, longest)
    section.pictures += [
        save.save(
            f"{name}-threshold",
            figures.success_against_threshold(trials.rows_of, radius),
            "Success against the threshold on the task error (Fig. 6A). Dashed: the goal's tolerance.",
        ),
        save.save(
            f"{name}-time",
            figures.success_against_time(trials.rows_of, horizon),
            "Success against the time of a trial: planning plus simulated execution.",
        ),
        save.save(f"{name}-outcomes", figures.outcomes(summary), "How the trials ended."),
        save.save(f"{name}-spent", figures.time_spent(summary), "Where the time of a trial goes."),
        save.save(
            f"{name}-scenes",
            figures.gallery(trials.scenes, trials.rows_of[trials.reference]),
            f"The scenes: start, goal (green), and as frame the outcome of the first trial of {trials.reference}.",
            wide=True,
        ),
    ]
    return section


def _learning_section(sources: Sources, save: _Figures) -> _Section | None:
    models = [model for model in sources.models if model.metrics]
    if not models:
        return None
    section = _Section(
        "Learning", "Numbers without another word are of test data, which no training, threshold or choice has seen."
    )
    section.tables += model_figures.metrics_tables(models)
    section.pictures += [save.save(f"model-{n}", *figure) for n, figure in enumerate(model_figures.pictures(models))]
    return section


def _evidence_section(sources: Sources, save: _Figures) -> _Section | None:
    drawn = [figure for folder in sources.evidence for figure in evidence_figures.pictures(folder)]
    if not drawn:
        return None
    section = _Section("What the method sees", "Drawn from recorded data and the trained models.")
    section.pictures += [save.save(f"evidence-{n}", *figure) for n, figure in enumerate(drawn)]
    return section


def _sensitivity_section(folder: Path, number: int, save: _Figures) -> _Section:
    title, table, canvas = threshold_sensitivity(folder)
    caption = "Threshold sensitivity (Fig. S2): a classifier for each δ. Dashed: the δ of the dynamics."
    lead = (
        "The same classifier, trained at one δ after another and tried on the same random scenes, drawn for this alone."
    )
    picture = save.save(f"sensitivity-{number}", canvas, caption)
    return _Section(title, lead, tables=[table], pictures=[picture])


def _headline(sources: Sources) -> tuple[str, str]:
    """The title and the sentence under it, from the numbers alone."""
    if not sources.trials:
        return "Fairlead", "Models and data; no trials yet."
    trials = sources.trials[0]
    methods, scenario = trials.summary["methods"], trials.config["scenario"].replace("_", "-")
    ours = trials.reference
    tried = counted(methods[ours]["trials"], "trial")
    text = f"{ours} reaches the goal in {tables.rate(methods[ours]['success'])} of {tried}"
    if "accept-all" in methods and ours != "accept-all":
        text += f"; the same planner without trust (accept-all) in {tables.rate(methods['accept-all']['success'])}"
    return f"Rope {scenario}: planning only through what is trusted", text + "."


def write_report(folders: Sequence[Path], out: Path, videos: bool = True, cameras: Cameras = no_camera) -> Path:
    """Write the page, figures, videos through `cameras` and Markdown tables into `out`; returns the page's path.

    What an earlier report there had written and this one has not is removed; whatever else is there stays.

    Raises:
        ArtifactError: a folder is missing, nothing finished is found, or `out` holds something other than a report.
    """
    sources, earlier, save = find_sources(folders), _earlier(out), _Figures(out)
    sections: list[_Section | None] = []
    for trials in sources.trials:
        clips = make_videos(trials, out / "videos", cameras) if videos else []
        sections.append(_trial_section(trials, save, trials.folder.name, clips))
    sections += [_sensitivity_section(folder, n, save) for n, folder in enumerate(sources.sensitivity)]
    sections += [_learning_section(sources, save), _evidence_section(sources, save)]
    present = [section for section in sections if section is not None]
    (title, headline), provenance = _headline(sources), provenance_table(sources)
    loader = jinja2.PackageLoader("fairlead.report", "templates")
    template = jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    page = template.get_template("page.html").render(
        title=title, headline=headline, sections=present, provenance=provenance
    )
    write_atomic(out / PAGE, page)
    parts = [f"# {title}", headline]
    for section in present:
        parts += [f"## {section.title}", section.lead, *(table.markdown() for table in section.tables)]
    write_atomic(out / TABLES, "\n\n".join([*parts, provenance.markdown()]))
    written = {out / PAGE, out / TABLES}
    for section in present:
        written |= {picture.path for picture in section.pictures}
        written |= {path for clip in section.clips for path in (clip.path, clip.gif) if path is not None}
    for path in earlier - written:
        path.unlink(missing_ok=True)
    inputs = {t.folder.name: sha256(t.folder / MANIFEST) for t in sources.trials}
    files = {str(path.relative_to(out)): sha256(path) for path in sorted(written)}
    Manifest("report", {"folders": [folder.name for folder in folders]}, 0, files, inputs, {}).write(out)
    return out / PAGE


def _earlier(out: Path) -> set[Path]:
    """The figures and videos of the report that `out` holds already."""
    if not (out / MANIFEST).exists():
        return set()
    return {out / name for name in read_manifest(out, "report").files if name.startswith(("figures/", "videos/"))}
