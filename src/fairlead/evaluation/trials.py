"""Trials of methods x scenes x seeds, resumable trial by trial.

A folder of trials holds:

    config.json     what runs that share the folder must have in common, and the reference where one was stated
    trials.jsonl    one object a trial, with the revision of the code and the machine, appended and synced as it ends
    traces/METHOD/SCENE-SEED/   the traces that were asked for
    scenes.json     the scenes that were tried
    summary.json    the statistics of all its trials
    manifest.json   written last, when every trial asked for is there
"""

from __future__ import annotations

import math
import shutil
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any, final

from fairlead.core import plugins
from fairlead.core.artifacts import (
    MANIFEST,
    Manifest,
    alone,
    append_jsonl,
    git_revision,
    read_json,
    read_jsonl,
    read_manifest,
    sha256,
    verify_files,
    write_atomic,
    write_json,
)
from fairlead.core.cores import cores, machine
from fairlead.core.errors import ArtifactError, UnknownNameError
from fairlead.evaluation.bench import Bench, Job, Row, TrialsConfig
from fairlead.evaluation.methods import in_order
from fairlead.evaluation.planners import PLANNERS
from fairlead.evaluation.summary import summarise
from fairlead.evaluation.workers import run_jobs
from fairlead.scenarios.registry import scenario_fingerprint
from fairlead.scenarios.scene_files import write_scenes

TRIALS, SUMMARY, SCENES, CONFIG = "trials.jsonl", "summary.json", "scenes.json", "config.json"
OFF = {"remember": False, "distilled": False}
"""Settings that folders of earlier versions do not mention."""


@final
class Trials:
    """A folder of trials, and those of a configuration that it does not hold yet.

    Interrupted at any moment, the folder keeps every trial that has ended; the same configuration goes on from there.

    Args:
        config: what to try.
        out: the folder.

    Raises:
        FairleadError: an unknown name, a bad scene, a missing model, or `out` belongs to another configuration. Nothing
            has been written then.
    """

    def __init__(self, config: TrialsConfig, out: Path) -> None:
        _ours(config, out)
        self._bench, self._out, self._revision = Bench(config), out, git_revision()
        tried = {*config.methods, *(row["method"] for row in read_jsonl(out / TRIALS))}
        if config.reference not in {None, *tried}:
            raise UnknownNameError("reference", str(config.reference), tried)
        _merged(out, identity(self._bench), config.reference)
        self.missing = _missing(self._bench, out)

    def run(self, workers: int = 1, ended: Callable[[Row], None] = lambda row: None) -> dict[str, Any]:
        """Run what is missing in so many processes, tell `ended` each row, and finish the folder.

        Timed trials take a core each: with a budget in seconds there are no more processes than cores.

        With a counted budget the rows do not depend on `workers`, but for their order. Returns the summary of all the
        folder's trials.

        Raises:
            ArtifactError: another process runs trials of this folder.
        """
        started = time.monotonic()
        if math.isfinite(self._bench.config.budget.seconds):
            workers = min(workers, cores())
        with alone(self._out):
            repair(self._out / TRIALS)
            _claim(self._out, _merged(self._out, identity(self._bench), self._bench.config.reference))
            self.missing = _missing(self._bench, self._out)
            if self.missing:
                (self._out / MANIFEST).unlink(missing_ok=True)
            made_by = {"revision": self._revision, "machine": machine()}
            for job in self.missing:
                shutil.rmtree(_trace(self._out, job.method, job.scene, job.seed), ignore_errors=True)
            with closing(run_jobs(self._bench.config, self.missing, workers)) as rows:
                for row in rows:
                    append_jsonl(self._out / TRIALS, row | made_by)
                    ended(row)
            return _finish(self._bench, self._out, time.monotonic() - started)


def _ours(config: TrialsConfig, out: Path) -> None:
    """ArtifactError where `out` holds something else than trials, or the scenes that would be overwritten."""
    if (out / MANIFEST).exists():
        read_manifest(out, "trials")
    elif out.is_dir():
        found = {path.name for path in out.iterdir() if not path.name.startswith(".")}
        if found and not found & {CONFIG, TRIALS}:
            raise ArtifactError(out, "not empty, and holds no trials; use another --out")
    if config.scenes.resolve() == (out / SCENES).resolve():
        raise ArtifactError(config.scenes, "would be replaced by the scenes that are tried; use another --out")


def identity(bench: Bench) -> dict[str, Any]:
    """What runs that share a folder have in common: all but which methods, scenes and seeds are tried.

    Of the models those that the methods use: runs with other methods may share the folder, and add theirs.
    """
    config = bench.config
    installed = {
        "scenario_sha256": scenario_fingerprint(config.scenario),
        "planner_sha256": plugins.fingerprint("planner", config.planner, PLANNERS),
    }
    return {
        **{key: digest for key, digest in installed.items() if digest},
        "scenario": config.scenario,
        "scenes": config.scenes.stem,
        "scenes_sha256": sha256(config.scenes),
        "models": dict(bench.models.hashes),
        **bench.models.settings,
        "budget": str(config.budget),
        "protocol": config.protocol.label,
        "planner": config.planner,
        "differences": "" if config.differences is None else str(config.differences),
        "remember": config.remember,
        "distilled": config.distilled,
    }


def repair(path: Path) -> None:
    """Cut off an unfinished last line, which a killed writer left, so that the next row does not continue it."""
    content = path.read_bytes() if path.exists() else b""
    whole = content[: content.rfind(b"\n") + 1]
    if whole != content:
        write_atomic(path, whole)


def _merged(out: Path, wanted: dict[str, Any], reference: str | None) -> dict[str, Any]:
    """The folder's configuration with this one's models and reference; ArtifactError where it is another one's."""
    path = out / CONFIG
    found = {**OFF, **read_json(path)} if path.exists() else {"models": {}}
    if "models" not in found:
        raise ArtifactError(path, "not the configuration of trials; choose another --out")
    if not path.exists() and any(read_jsonl(out / TRIALS)):
        raise ArtifactError(out / TRIALS, f"trials without their {CONFIG}, of nobody knows what; choose another --out")
    before, now = (_flat(config) for config in (found, wanted))
    for key, value in now.items():
        if key in before and before[key] != value:
            digest = key.endswith("_sha256") or key not in found
            was, now_is = (text[:12] if digest else text for text in (str(before[key]), str(value)))
            raise ArtifactError(path, f"these trials had another {key} ({was}, now {now_is}); choose another --out")
    merged = {**found, **wanted, "models": {**found["models"], **wanted["models"]}}
    if reference is not None:
        merged["reference"] = reference
    return merged


def _flat(config: dict[str, Any]) -> dict[str, Any]:
    """Settings by their names, models as `model NAME`, installed parts by their kinds and names."""
    models = {name if " " in name else f"model {name}": value for name, value in config["models"].items()}
    return {**{key: value for key, value in config.items() if key != "models"}, **models}


def _claim(out: Path, config: dict[str, Any]) -> None:
    """Make the folder this configuration's."""
    path = out / CONFIG
    if not path.exists() or {**OFF, **read_json(path)} != config:
        (out / MANIFEST).unlink(missing_ok=True)
        write_json(path, config)


def _trace(out: Path, method: str, scene: str, seed: int) -> Path:
    return out / "traces" / method / f"{scene}-{seed}"


def _missing(bench: Bench, out: Path) -> list[Job]:
    """The trials that the folder does not hold, scene by scene, so that methods can be compared early."""
    done = {(row["method"], row["scene"], row["seed"]) for row in read_jsonl(out / TRIALS)}
    config = bench.config
    scenes = [scene.name for scene in bench.scenes.scenes[: config.limit]]
    wanted = [(m, s, seed) for s in scenes for seed in config.seeds for m in config.methods]

    def trace(method: str, scene: str, seed: int) -> Path | None:
        kept = seed == config.seeds[0] and scene in scenes[: config.traced]
        return _trace(out, method, scene, seed) if kept else None

    return [Job(*names, trace(*names)) for names in wanted if names not in done]


def _finish(bench: Bench, out: Path, wall_s: float) -> dict[str, Any]:
    """Summary, scenes and manifest from the rows on disk; a finished folder that gained nothing stays as it is."""
    if (out / MANIFEST).exists():
        verify_files(out, read_manifest(out, "trials"))
        return read_json(out / SUMMARY)
    config, rows, about = bench.config, list(read_jsonl(out / TRIALS)), read_json(out / CONFIG)
    methods, seeds = in_order(row["method"] for row in rows), sorted({row["seed"] for row in rows})
    summary = summarise(rows, methods, seeds[0], about.pop("reference", None))
    write_json(out / SUMMARY, summary)
    tried = {row["scene"] for row in rows}
    scenes = [scene for scene in bench.scenes.scenes if scene.name in tried]
    write_scenes(out / SCENES, config.scenario, scenes, f"the scenes of {config.scenes.name} that were tried here")
    inputs = {"scenes": about.pop("scenes_sha256"), **about.pop("models")}
    about |= {"methods": methods, "seeds": seeds, "reference": summary["reference"]}
    files = {name: sha256(out / name) for name in (CONFIG, TRIALS, SUMMARY, SCENES)}
    extra = {"trials": len(rows), "scenes": len(scenes)}
    extra |= {f"{key}s": sorted({row.get(key, "unknown") for row in rows}) for key in ("revision", "machine")}
    Manifest("trials", about, seeds[0], files, inputs, extra, wall_s).write(out)
    return summary
