"""The whole line at its smallest: everything it promises is there, and a second run does nothing again."""

from __future__ import annotations

import json
import shutil
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import pytest
import torch
from safetensors.torch import load_file

from fairlead.core.artifacts import read_jsonl, read_manifest
from fairlead.core.budget import Budget
from fairlead.core.errors import ArtifactError, UnknownNameError
from fairlead.evaluation.bench import TrialsConfig
from fairlead.evaluation.planners import BEST
from fairlead.evaluation.shipped import benchmark_scenes
from fairlead.execution.trial import Protocol
from fairlead.learning.registry import load_delta
from fairlead.report import movie
from fairlead.report.movie import Card, Take, takes, write_movie
from fairlead.report.page import write_report
from fairlead.report.playback import FPS
from fairlead.report.sources import TrialSet, find_sources
from fairlead.report.stage import no_camera
from fairlead.reproduce import stages, trials
from fairlead.reproduce.line import reproduce
from fairlead.reproduce.presets import PRESETS, SensitivityConfig, preset
from fairlead.reproduce.scene_sets import SETS, scene_sets
from fairlead.reproduce.sensitivity import sensitivity
from fairlead.scenarios.registry import scenario

DRAGGING = scenario("dragging")
SMOKE = replace(preset(DRAGGING, "smoke"), obstacles_every=2)


@contextmanager
def _no_bar(title: str, total: int, unit: str):
    yield lambda count: None


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("line")
    reproduce(DRAGGING, SMOKE, out, 0, 2, _no_bar)
    return out


def test_every_method_was_tried_and_reported(line: Path) -> None:
    rows = list(read_jsonl(line / "trials" / "benchmark" / "trials.jsonl"))
    assert {row["method"] for row in rows} == set(SMOKE.methods)
    page = (line / "report" / "report.html").read_text()
    assert all(method in page for method in SMOKE.methods)
    assert 'src="http' not in page


def test_the_dual_arm_takes_the_same_line(tmp_path: Path) -> None:
    dual_arm = scenario("dual_arm")
    reproduce(dual_arm, preset(dual_arm, "smoke"), tmp_path, 0, 2, _no_bar)
    rows = list(read_jsonl(tmp_path / "trials" / "benchmark" / "trials.jsonl"))
    assert {row["method"] for row in rows} == set(preset(dual_arm, "smoke").methods)
    assert "trust+recovery" in (tmp_path / "report" / "report.html").read_text()


@pytest.mark.parametrize(("name", "every"), [("phase1", 8), ("phase2", 2)])
def test_obstacles_move_as_often_as_the_preset_says(line: Path, name: str, every: int) -> None:
    assert read_manifest(line / "data" / name, "dataset").config["obstacles_every"] == every


def test_a_set_of_scenes_that_is_not_here_is_left_out_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FAIRLEAD_AUTHORS_SCENES", str(tmp_path))
    told: list[str] = []
    assert set(scene_sets(DRAGGING, SETS, tmp_path, 0, told.append)) == {"benchmark", "hard"}
    assert len(told) == 1
    assert "authors" in told[0]
    assert "FAIRLEAD_AUTHORS_SCENES" in told[0]
    shutil.copy(benchmark_scenes("dragging"), tmp_path / "dragging.json")
    assert scene_sets(DRAGGING, SETS, tmp_path, 0, told.append)["authors"] == tmp_path / "dragging.json"
    assert len(told) == 1


def test_each_set_is_a_folder_and_only_stuck_methods_without_recovery_meet_the_papers_protocol(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A trial that is never stuck, or recovers, is the same under both protocols."""
    tried: dict[str, TrialsConfig] = {}
    stuck = {"trust": 2, "trust+recovery": 3, "trust-sdf": 0, "accept-all": 0}

    def try_all(config: TrialsConfig, out: Path, *_: object) -> dict[str, Any]:
        tried[out.name] = config
        return {"methods": {name: {"stuck_trials": count} for name, count in stuck.items()}}

    monkeypatch.setattr(trials, "try_all", try_all)
    wanted = replace(SMOKE, methods=tuple(stuck), sets={"hard": None, "authors": 3}, seeds=(4, 5), both_protocols=True,
                     counted=Budget(extensions=7), planner="rrt", improved=("accept-all", "trust"),
                     improved_planner=BEST, improved_seeds=(6, 7))  # fmt: skip
    scenes = benchmark_scenes("dragging")
    trials.try_sets(DRAGGING, wanted, tmp_path, {"hard": scenes, "authors": scenes}, tmp_path, 1, _no_bar)
    papers = {"hard-protocol-paper", "authors-protocol-paper"}
    best = {"hard-improved", "authors-improved"}
    assert set(tried) == {"hard", "hard-counted", "authors", *papers, *best}
    assert {name for name, config in tried.items() if config.planner == BEST} == best
    assert {name for name, config in tried.items() if config.distilled} == best
    assert {(tried[n].methods, tried[n].seeds, tried[n].reference) for n in best} == {
        (("accept-all", "trust"), (6, 7), "accept-all")
    }
    assert {tried[name].methods for name in papers} == {("trust",)}
    assert {name for name, config in tried.items() if config.protocol is Protocol.PAPER} == papers
    assert (tried["hard"].limit, tried["authors"].limit) == (None, 3)
    assert [name for name, config in tried.items() if config.traced] == ["hard", "authors"]
    assert (str(tried["hard-counted"].budget), tried["hard-counted"].seeds) == ("extensions=7", (4,))


def test_thresholds_share_their_labels_and_change_nothing(line: Path, tmp_path: Path) -> None:
    """A classifier is the same as one trained alone, again nothing is made again, and the page shows them as one."""
    data, dynamics, out = line / "data" / "phase2", line / "models" / "dynamics", tmp_path / "sensitivity"
    delta = load_delta(dynamics, "dragging")
    config = SensitivityConfig((delta / 2, delta), scenes=1, budget=Budget(extensions=50))
    made = []
    for _ in range(2):
        sensitivity(DRAGGING, config, SMOKE.trust_sdf, data, dynamics, out, 0, 1, _no_bar)
        made.append({path: path.stat().st_mtime_ns for path in out.rglob("manifest.json")})
    assert made[0] == made[1]
    assert len(made[0]) == 4 + 1
    alone = tmp_path / "alone"
    stages.trust(DRAGGING, data, dynamics, replace(SMOKE.trust_sdf, delta_m=delta / 2), alone, 0)
    # Not the files: the order of the header's entries differs from one writing to another.
    weights = [
        load_file(folder / "model.safetensors") for folder in (alone, out / f"delta-{delta / 2:g}" / "trust-sdf")
    ]
    assert all(torch.equal(tensor, weights[1][name]) for name, tensor in weights[0].items())
    found = find_sources([out])
    assert (found.trials, found.models, found.sensitivity) == ((), (), (out,))
    write_report([out], tmp_path / "report", videos=False)
    text = (tmp_path / "report" / "report.md").read_text()
    assert all(f"| {delta:g} | " in text for delta in config.deltas_m)


def test_a_movie_has_every_part_at_its_length(line: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A card lasts as long as it says, and a trial no longer than the longest: here a second, to be fast."""
    monkeypatch.setattr(movie, "LONGEST_S", 1)
    found, card = TrialSet(line / "trials" / "benchmark"), Card("Title", ("a line",), 0.4)
    parts: list[Card | Take] = [card, *takes(found, 2), card]
    assert len(parts) == 3  # one scene was tried
    counted: list[Card | Take] = []
    write_movie(tmp_path / "movie.mp4", parts, no_camera, counted.append)
    assert counted == parts
    frames, _ = imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "movie.mp4"))
    assert 2 * 0.4 * FPS < frames <= 2 * 0.4 * FPS + movie.LONGEST_S * FPS + 1


def test_every_artifact_has_a_manifest(line: Path) -> None:
    folders = [*(line / "data").iterdir(), *(line / "models").iterdir(), *(line / "trials").iterdir(), line / "report"]
    for folder in folders:
        manifest = json.loads((folder / "manifest.json").read_text())
        assert manifest["files"], folder
        assert {"git", "versions", "hardware", "command", "seed"} <= set(manifest)


def test_a_second_run_trains_nothing_again(line: Path) -> None:
    weights = sorted((line / "models").glob("*/model.safetensors"))
    before = [(path, path.stat().st_mtime_ns) for path in weights]
    models, phase2 = line / "models", line / "data" / "phase2"
    stages.dynamics(DRAGGING, line / "data" / "phase1", SMOKE.dynamics, models / "dynamics", 0)
    full, among = stages.Part(phase2, SMOKE.full), stages.Part(phase2, SMOKE.phase2)
    stages.full_dynamics(DRAGGING, full, SMOKE.full_dynamics, models / "full-dynamics", 0)
    stages.trust(DRAGGING, among, models / "dynamics", SMOKE.trust_sdf, models / "trust-sdf", 0)
    assert before == [(path, path.stat().st_mtime_ns) for path in weights]


def test_a_finished_model_is_never_taken_for_another_nor_overwritten(line: Path) -> None:
    data, model = {"data": line / "data" / "phase1"}, line / "models" / "dynamics"
    assert stages.finished(model, SMOKE.dynamics, data, 0)
    with pytest.raises(ArtifactError, match="other seed"):
        stages.finished(model, SMOKE.dynamics, data, 1)
    with pytest.raises(ArtifactError, match="other settings"):
        stages.finished(model, replace(SMOKE.dynamics, hidden=33), data, 0)
    others: list[Path | stages.Part] = [line / "data" / "phase2", stages.Part(line / "data" / "phase1", 8)]
    for other in others:
        with pytest.raises(ArtifactError, match="other inputs"):
            stages.finished(model, SMOKE.dynamics, {"data": other}, 0)


def test_data_of_another_stage_are_refused_by_name(line: Path, tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match=r"manifest\.json"):
        stages.dynamics(DRAGGING, tmp_path / "nothing", SMOKE.dynamics, tmp_path / "model", 0)
    with pytest.raises(ArtifactError, match="dataset of phase '2'; one of '1'"):
        stages.dynamics(DRAGGING, line / "data" / "phase2", SMOKE.dynamics, tmp_path / "model", 0)
    assert not (tmp_path / "model" / "manifest.json").exists()


def test_names_of_presets() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'desk'"):
        preset(DRAGGING, "dekc")
    assert set(PRESETS["dragging"]) == {"smoke", "desk", "paper", "evidence"}


@pytest.mark.parametrize("name", ["dragging", "dual_arm"])
def test_the_paper_preset_has_the_papers_data(name: str) -> None:
    world = scenario(name)
    sizes = preset(world, "paper")
    (first, _), (second, _) = world.paper_data
    assert (sizes.phase1, sizes.phase2, sizes.steps2, sizes.dynamics.members) == (first, second, 0, 8)


@pytest.mark.parametrize("name", ["dragging", "dual_arm"])
def test_evidence_goes_on_where_the_paper_preset_ended(name: str) -> None:
    """Same data, same models, and each trial of the paper's preset is one of its own."""
    paper, evidence = preset(scenario(name), "paper"), preset(scenario(name), "evidence")
    more = ("sets", "improved_seeds", "both_protocols", "counted", "sensitivity")
    assert replace(evidence, **{field: getattr(paper, field) for field in more}) == paper
    assert set(paper.improved_seeds) < set(evidence.improved_seeds)
    assert evidence.sets == dict.fromkeys(paper.sets)


@pytest.mark.parametrize("size", ["desk", "paper"])
@pytest.mark.parametrize("name", ["dragging", "dual_arm"])
def test_full_dynamics_see_as_much_as_the_others_together(name: str, size: str) -> None:
    sizes, ((_, steps1), (_, steps2)) = preset(scenario(name), size), scenario(name).paper_data
    steps2 = sizes.steps2 or steps2
    assert sizes.full * steps2 == pytest.approx(sizes.phase1 * steps1 + sizes.phase2 * steps2, rel=0.01)


def test_the_benchmark_scenes_come_with_the_package() -> None:
    assert len(DRAGGING.scenes(benchmark_scenes("dragging")).scenes) == 50
