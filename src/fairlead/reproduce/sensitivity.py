"""Threshold sensitivity (paper, Fig. S2): trust at other deltas, each tried on random scenes drawn for this alone.

A folder of it holds `scenes.json`; for each delta `delta-D` with the classifier, a link to its dynamics and its trials;
and, when all are there, `sensitivity.json`, one row a delta, with a manifest.
"""

from __future__ import annotations

import os
import time
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

from fairlead.core.artifacts import MANIFEST, Manifest, read_json, read_manifest, sha256, verify_files, write_json
from fairlead.evaluation.bench import TrialsConfig
from fairlead.learning.model_files import Job
from fairlead.learning.registry import load_delta, load_dynamics
from fairlead.learning.trust import Labelled, fit_trust
from fairlead.learning.trust_network import TrustConfig
from fairlead.reproduce import stages
from fairlead.reproduce.presets import SensitivityConfig
from fairlead.reproduce.scene_sets import drawn
from fairlead.reproduce.trials import Bar, try_all
from fairlead.scenarios.scenario import Scenario

KIND, METHOD, SEED, ROWS = "sensitivity", "trust-sdf", 2029, "sensitivity.json"
"""Of its manifest; what is tried; of its scenes, which no benchmark has; what a finished folder holds."""


def sensitivity(
    scenario: Scenario,
    config: SensitivityConfig,
    trust: TrustConfig,
    data: stages.Data,
    dynamics: Path,
    out: Path,
    seed: int,
    workers: int,
    bar: Bar,
) -> None:
    """Train `trust` at each delta on the phase 2 data and dynamics in those folders, and try it.

    A finished folder that gained nothing stays as it is.
    """
    began = time.monotonic()
    scenes = drawn(scenario, out / "scenes.json", config.scenes, SEED)

    @cache
    def labelled(device: Any) -> Labelled:
        found = stages.splits(data, scenario, 2)
        return Labelled.by(load_dynamics(dynamics, scenario.kin, device), found, max(config.deltas_m), trust)

    def train(delta: float, job: Job) -> None:
        fit_trust(labelled(job.device).at(delta), replace(trust, delta_m=delta), job)

    before = read_manifest(out, KIND).inputs if (out / MANIFEST).exists() else {}
    if before.keys() != {"scenes", *map(_name, config.deltas_m)}:
        (out / MANIFEST).unlink(missing_ok=True)
    rows, inputs = [], {"scenes": sha256(scenes)}
    for delta in config.deltas_m:
        folder, made_from = out / _name(delta), {"data": data, "dynamics": dynamics}
        _link(folder / "dynamics", dynamics)
        settings = replace(trust, delta_m=delta)
        stages.train_once(scenario, folder / METHOD, settings, made_from, seed, partial(train, delta))
        trials = TrialsConfig(scenario.name, folder, scenes, (METHOD,), config.budget, traced=0)
        summary = try_all(trials, folder / "trials", workers, bar)
        rows.append(_row(delta, summary["methods"][METHOD], read_json(folder / METHOD / "metrics.json")["test"]))
        inputs[folder.name] = sha256(folder / "trials" / MANIFEST)
    if inputs == before:
        return verify_files(out, read_manifest(out, KIND))
    write_json(out / ROWS, rows)
    about = {"scenario": scenario.name, "method": METHOD, "budget": str(config.budget)}
    extra = {"own_delta_m": load_delta(dynamics, scenario.kin)}
    files = {ROWS: sha256(out / ROWS)}
    Manifest(KIND, about, seed, files, inputs, extra, time.monotonic() - began).write(out)


def _name(delta: float) -> str:
    return f"delta-{delta:g}"


def _row(delta: float, tried: dict[str, Any], judged: dict[str, Any]) -> dict[str, Any]:
    """What is reported of one delta: trials, and what the classifier says of test examples."""
    return {
        "delta_m": delta,
        "mean_error_m": tried["error_m"]["mean"],
        **{key: tried[key] for key in ("trials", "success", "first_plan_success", "stuck_trials")},
        **{key: judged[key] for key in ("examples", "reliable_share", "accepted_share", "accuracy", "auroc")},
    }


def _link(link: Path, target: Path) -> None:
    """A relative link, so that the whole may be moved; one to elsewhere is replaced."""
    where = os.path.relpath(target, link.parent)
    if link.is_symlink() and os.readlink(link) != where:
        link.unlink()
    if not link.exists():
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(where)
