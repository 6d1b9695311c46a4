"""The page: one HTML file that needs nothing beside it, and the same tables as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import jinja2

from fairlead.core.artifacts import MANIFEST, Manifest, read_json, read_manifest, sha256, write_atomic
from fairlead.report import tables
from fairlead.report.sections import (
    Figures,
    Section,
    evidence_section,
    learning_section,
    overview_section,
    sensitivity_section,
    trial_section,
)
from fairlead.report.sources import Sources, find_sources
from fairlead.report.stage import Cameras, no_camera
from fairlead.report.tables import Table, counted
from fairlead.report.videos import make_videos

PAGE, TABLES = "report.html", "report.md"
TITLE = "planning only through what is trusted"


def _provenance(sources: Sources) -> Table:
    folders = [*(t.folder for t in sources.trials), *(m.folder for m in sources.models), *sources.datasets]
    found = [(folder, read_json(folder / MANIFEST)) for folder in [*folders, *sources.evidence, *sources.sensitivity]]
    rows = [
        (
            folder.name,
            manifest["kind"],
            str(manifest["seed"]),
            ", ".join(manifest["extra"].get("revisions", [manifest["git"]])),
            sha256(folder / MANIFEST)[:12],
            f"{manifest['wall_s']:.0f}",
            ", ".join(manifest["extra"].get("machines", ["{cores} x {machine}".format(**manifest["hardware"])])),
            ", ".join(
                f"{k} {v}" for k, v in manifest["versions"].items() if k in ("python", "mujoco", "torch", "ompl")
            ),
        )
        for folder, manifest in found
    ]
    columns = ("artifact", "kind", "seed", "revision", "manifest SHA-256", "wall [s]", "cores", "versions")
    note = "Trials may be of several runs: revisions and machines are those of all, the seconds those of the last."
    return Table("Artifacts", columns, tuple(rows), note)


def _headline(sources: Sources) -> tuple[str, str]:
    """The title and the sentence under it, from the numbers alone."""
    if not sources.trials:
        return "Fairlead", "Models and data; no trials yet."
    trials, references = sources.trials[0], {trials.reference for trials in sources.trials}
    first, *others = {trials.config["scenario"].replace("_", "-"): None for trials in sources.trials}
    title = TITLE.capitalize() if others else f"Rope {first}: {TITLE}"
    if others and len(references) == 1:
        means = tables.means({str(trials.folder): trials.summary for trials in sources.trials})
        if means:
            text = "; ".join(f"{name} {value}" for name, value in means.items())
            return title, f"Mean success and error over {len(sources.trials)} sets of trials: {text}."
    methods, ours = trials.summary["methods"], trials.reference
    tried = counted(methods[ours]["trials"], "trial") + (f" ({trials.name})" if len(sources.trials) > 1 else "")
    text = f"{ours} reaches the goal in {tables.rate(methods[ours]['success'])} of {tried}"
    if "accept-all" in tables.whole(trials.summary) and ours != "accept-all":
        text += f"; the same planner without trust (accept-all) in {tables.rate(methods['accept-all']['success'])}"
    return title, text + "."


def write_report(folders: Sequence[Path], out: Path, videos: bool = True, cameras: Cameras = no_camera) -> Path:
    """Write the page, figures, videos through `cameras` and Markdown tables into `out`; returns the page's path.

    What an earlier report there had written and this one has not is removed; whatever else is there stays.

    Raises:
        ArtifactError: a folder is missing, nothing finished is found, or `out` holds something other than a report.
    """
    sources, earlier, save = find_sources(folders), _earlier(out), Figures(out)
    sections: list[Section | None] = [overview_section(sources)]
    for trials in sources.trials:
        clips = make_videos(trials, out / "videos", cameras) if videos else []
        sections.append(trial_section(trials, save, clips, cameras))
    sections += [sensitivity_section(folder, number, save) for number, folder in enumerate(sources.sensitivity)]
    sections += [learning_section(sources, save), evidence_section(sources, save)]
    present = [section for section in sections if section is not None]
    (title, headline), provenance = _headline(sources), _provenance(sources)
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
    inputs = {t.name: sha256(t.folder / MANIFEST) for t in sources.trials}
    files = {str(path.relative_to(out)): sha256(path) for path in sorted(written)}
    Manifest("report", {"folders": [folder.name for folder in folders]}, 0, files, inputs, {}).write(out)
    return out / PAGE


def _earlier(out: Path) -> set[Path]:
    """The figures and videos of the report that `out` holds already."""
    if not (out / MANIFEST).exists():
        return set()
    return {out / name for name in read_manifest(out, "report").files if name.startswith(("figures/", "videos/"))}
