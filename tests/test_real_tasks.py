"""The real tasks' line at its smallest: two of the four, and what is reused, trained, tried and seen in training."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from fairlead.core.artifacts import read_jsonl, read_manifest, sha256
from fairlead.core.budget import Budget
from fairlead.core.errors import ArtifactError, UnknownNameError
from fairlead.data.store import load
from fairlead.evaluation.shipped import benchmark_scenes, shipped_models
from fairlead.reproduce import stages, tasks
from fairlead.reproduce.presets import Preset, preset
from fairlead.reproduce.tasks import METHODS, reproduce_tasks
from fairlead.scenarios.fetch_cable import FETCH_CABLE
from fairlead.scenarios.other_world import MOCKUP
from fairlead.scenarios.registry import scenario
from fairlead.scenarios.scenario import Scenario
from fairlead.scenarios.under_hood import INSTALL_HOSE

NAMES = ("fetch_cable", "install_hose")


@contextmanager
def _no_bar(title: str, total: int, unit: str):
    yield lambda count: None


def _tiny(task: Scenario, name: str) -> Preset:
    return replace(preset(task, name), phase2=8, steps2=3, budget=Budget(extensions=60))


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("tasks")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tasks, "TASKS", (FETCH_CABLE, INSTALL_HOSE))
        patch.setattr(tasks, "preset", _tiny)
        reproduce_tasks("smoke", out, 0, 1, _no_bar)
        made = [path for name in ("data", "models", "trials") for path in (out / name).rglob("*") if path.is_file()]
        before = {path: path.stat().st_mtime_ns for path in made}
        reproduce_tasks("smoke", out, 0, 1, _no_bar)
    assert before == {path: path.stat().st_mtime_ns for path in made}
    return out


def test_every_method_was_tried_in_another_world_and_reported(line: Path) -> None:
    page = (line / "report" / "report.html").read_text()
    for name in NAMES:
        trials = line / "trials" / f"{name}-mockup"
        assert {row["method"] for row in read_jsonl(trials / "trials.jsonl")} == {*METHODS}
        assert read_manifest(trials, "trials").config["differences"] == str(MOCKUP)
        assert f"{name}-mockup</h2>" in page
    assert "Overview</h2>" in page
    assert 'src="http' not in page


def test_what_the_paper_reuses_is_reused_and_the_rest_is_trained_on_the_task(line: Path) -> None:
    reused = [("fetch_cable", "dynamics"), ("fetch_cable", "trust-sdf"), ("install_hose", "dynamics")]
    for name, model in reused:
        shipped = shipped_models(name) / model / "manifest.json"
        assert sha256(line / "models" / name / model / "manifest.json") == sha256(shipped)
    trained = [("fetch_cable", "recovery-sdf", "dragging"), ("install_hose", "trust-sdf", "install_hose"),
               ("install_hose", "recovery-sdf", "install_hose")]  # fmt: skip
    for name, model, data in trained:
        inputs = read_manifest(line / "models" / name / model, "model").inputs
        assert inputs["data"] == sha256(line / "data" / data / "manifest.json")


def test_no_scene_that_is_tried_is_seen_in_training(line: Path) -> None:
    task = scenario("install_hose")
    tried = {environment_boxes(task, scene.obstacles) for scene in task.scenes(benchmark_scenes(task.name)).scenes}
    splits = load(line / "data" / task.name, task).values()
    seen = {tuple(environment.boxes) for data in splits for environment in data.environments}
    assert len(seen) > 1
    assert not seen & tried


def environment_boxes(task: Scenario, obstacles: object) -> tuple[object, ...]:
    return tuple(task.environment(obstacles).boxes)  # pyright: ignore[reportArgumentType,reportAttributeAccessIssue]


def test_a_reused_model_never_takes_the_place_of_another(line: Path, tmp_path: Path) -> None:
    models = shipped_models("dual_arm")
    stages.reused(models / "trust-sdf", tmp_path / "m")
    stages.reused(models / "trust-sdf", tmp_path / "m")
    with pytest.raises(ArtifactError, match="another model"):
        stages.reused(models / "dynamics", tmp_path / "m")


def test_an_unknown_preset_is_named_before_anything_is_made(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'desk'"):
        reproduce_tasks("dekc", tmp_path / "new", 0, 1, _no_bar)
    assert not (tmp_path / "new").exists()
