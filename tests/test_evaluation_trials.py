"""Trials: the same rows at any number of workers and after any interruption; no other configuration in the folder."""

from __future__ import annotations

import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fairlead.core.artifacts import (
    MANIFEST,
    append_jsonl,
    git_revision,
    read_json,
    read_jsonl,
    read_manifest,
    sha256,
    verify_files,
    write_json,
)
from fairlead.core.budget import Budget
from fairlead.core.cores import machine
from fairlead.core.errors import ArtifactError, FairleadError, UnknownNameError
from fairlead.core.records import Transitions, TrialOutcome
from fairlead.core.traces import EVENTS, read_trace
from fairlead.evaluation import trials
from fairlead.evaluation.bench import Bench, TrialsConfig, scaled
from fairlead.evaluation.bench import Job as Trial
from fairlead.evaluation.methods import CHECKS, DYNAMICS, METHODS, RECOVERIES, Parts, find_method
from fairlead.evaluation.models import Models
from fairlead.evaluation.planners import PLANNERS, NamedPlanner
from fairlead.evaluation.shipped import benchmark_scenes, shipped_models
from fairlead.evaluation.solved import solved_scenes
from fairlead.evaluation.trials import CONFIG, OFF, SCENES, SUMMARY, TRIALS, Trials, repair
from fairlead.learning.distilled import Distilled, DistilledConfig, Saved
from fairlead.learning.dynamics import DynamicsConfig, Ensemble, LearnedDynamics
from fairlead.learning.model_files import Job, save_model
from fairlead.planning.problem import PAPER, SearchSettings
from fairlead.planning.rrt import BatchedRRT
from fairlead.report.playback import recording, views
from fairlead.scenarios.other_world import Differences
from fairlead.scenarios.registry import scenario
from fairlead.scenarios.scene_files import write_scenes

ROW = {
    "scenario", "scenes", "scene", "method", "seed", "success", "error_m", "planning_s", "execution_s", "extensions",
    "plans", "recovery_actions", "actions", "outcome", "first_plan_success", "first_plan_error_m", "times_stuck",
    "reached_at_s", "budget", "protocol", "start_residual_m", "action_outcomes", "revision",
    "machine",
}  # fmt: skip


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> TrialsConfig:
    """Two methods on two scenes, with a dynamics model that was never trained, and a small counted budget."""
    folder, world = tmp_path_factory.mktemp("inputs"), scenario("dragging")
    scenes = [world.random_scene(np.random.default_rng(seed), f"scene-{seed}") for seed in range(2)]
    write_scenes(folder / "made.json", "dragging", scenes, "a test")
    settings = DynamicsConfig(hidden=8, members=2)
    tensors = Ensemble(world.layout, settings, 0).state_dict()
    job = Job(folder / "models" / "dynamics", "dragging")
    save_model(job, "dynamics", settings.network, world.layout, settings, tensors, {"delta_m": 0.1}, 0.0)
    small = Distilled(world.layout, settings, DistilledConfig(), 0)
    both = Saved(DistilledConfig(), settings)
    inputs = {"dynamics": sha256(job.folder / MANIFEST)}
    save_model(Job(folder / "models" / "distilled", "dragging", 0, inputs), "distilled", settings.network, world.layout,
               both, small.state_dict(), {}, 0.0)  # fmt: skip
    methods = ("collision-check", "accept-all")
    return TrialsConfig("dragging", folder / "models", folder / "made.json", methods, Budget(extensions=300), traced=1)


@pytest.fixture(scope="module")
def finished(config: TrialsConfig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an uninterrupted run with one worker."""
    out = tmp_path_factory.mktemp("out") / "trials"
    Trials(config, out).run(workers=1)
    return out


def rows(out: Path) -> list[dict[str, Any]]:
    return sorted(read_jsonl(out / TRIALS), key=lambda row: (row["scene"], row["method"], row["seed"]))


def test_rows_have_the_fields_that_users_read(finished: Path) -> None:
    found = rows(finished)
    assert len(found) == 4
    assert all(set(row) == ROW for row in found)
    assert {row["extensions"] for row in found} <= set(range(301))


def test_the_number_of_workers_does_not_matter(config: TrialsConfig, finished: Path, tmp_path: Path) -> None:
    summary = Trials(config, tmp_path).run(workers=2)
    assert rows(tmp_path) == rows(finished)
    assert summary["order"] == ["accept-all", "collision-check"]  # of the table, not of the command
    assert summary["reference"] == "accept-all"


def test_solved_scenes_are_those_with_a_success_in_the_order_of_their_file(
    config: TrialsConfig, finished: Path, tmp_path: Path
) -> None:
    """Whoever solved one; nothing is taken from trials of another file or from rows that were changed."""
    world, path = scenario("dragging"), config.scenes
    first, second = (scene.name for scene in world.scenes(path).scenes)

    def told(name: str, **solved: str) -> Path:
        shutil.copytree(finished, folder := tmp_path / name)
        changed = [
            {**row, "success": solved.get(row["method"].replace("-", "_")) == row["scene"]} for row in rows(folder)
        ]
        (folder / TRIALS).write_text("".join(json.dumps(row) + "\n" for row in changed))
        manifest = read_manifest(folder, "trials")
        replace(manifest, files={**manifest.files, TRIALS: sha256(folder / TRIALS)}).write(folder)
        return folder

    one, other, none = told("one", accept_all=second), told("other", collision_check=first), told("none")
    assert [scene.name for scene in solved_scenes(world, path, [one, other], 2)[0]] == [first, second]
    found, source = solved_scenes(world, path, [none, one], 1)
    assert [scene.name for scene in found] == [second]
    assert source.startswith("a test: the first 1 of 2 that were solved by ")
    assert "accept-all (one, manifest" in source
    assert source.endswith("1 before the last of them were not, or were not tried")
    with pytest.raises(FairleadError, match="count 2: 1 of the 2 scenes"):
        solved_scenes(world, path, [one], 2)
    write_scenes(tmp_path / "made.json", "dragging", world.scenes(path).scenes[:1], "another")
    with pytest.raises(ArtifactError, match="other scenes"):
        solved_scenes(world, tmp_path / "made.json", [one], 1)
    append_jsonl(one / TRIALS, rows(one)[0])
    with pytest.raises(ArtifactError, match="damaged"):
        solved_scenes(world, path, [one], 1)


def test_an_interrupted_run_goes_on_to_the_same_rows(config: TrialsConfig, finished: Path, tmp_path: Path) -> None:
    def stop(row: dict[str, Any]) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Trials(config, tmp_path).run(workers=1, ended=stop)
    assert len(rows(tmp_path)) == 1
    assert not (tmp_path / MANIFEST).exists()
    with (tmp_path / TRIALS).open("a") as file:
        file.write('{"scenario": "dragg')
    again = Trials(config, tmp_path)
    assert len(again.missing) == 3
    again.run(workers=1)
    assert rows(tmp_path) == rows(finished)
    made_by = {"revisions": [git_revision()], "machines": [machine()]}
    assert read_manifest(tmp_path, "trials").extra == {"trials": 4, "scenes": 2, **made_by}


def test_rows_of_another_revision_are_told_of(config: TrialsConfig, finished: Path, tmp_path: Path) -> None:
    """Going on with other code is allowed, and the manifest says that it happened."""
    old = rows(finished)[:2]
    shutil.copy(finished / CONFIG, tmp_path / CONFIG)
    (tmp_path / TRIALS).write_text("".join(json.dumps(row | {"revision": "older"}) + "\n" for row in old))
    Trials(config, tmp_path).run(workers=1)
    assert read_manifest(tmp_path, "trials").extra["revisions"] == sorted({"older", git_revision()})


def test_rows_that_say_nothing_of_their_settings_are_not_gone_on_with(
    config: TrialsConfig, finished: Path, tmp_path: Path
) -> None:
    shutil.copy(finished / TRIALS, tmp_path / TRIALS)
    with pytest.raises(ArtifactError, match="trials without their"):
        Trials(config, tmp_path)


def test_a_trace_that_a_killed_trial_left_goes_though_its_successor_keeps_none(
    config: TrialsConfig, tmp_path: Path
) -> None:
    left = tmp_path / "traces" / config.methods[0] / "scene-0-0"
    left.mkdir(parents=True)
    (tmp_path / TRIALS).touch()
    Trials(replace(config, limit=1, traced=0), tmp_path).run(workers=1)
    assert not left.exists()


def test_nothing_is_written_before_the_run(config: TrialsConfig, finished: Path, tmp_path: Path) -> None:
    """Another process may be at work there."""
    Trials(config, tmp_path / "new")
    assert not (tmp_path / "new").exists()
    shutil.copytree(finished, tmp_path / "old")
    with (tmp_path / "old" / TRIALS).open("a") as file:
        file.write('{"scenario": "dragg')
    before = {path: path.read_bytes() for path in (tmp_path / "old").rglob("*") if path.is_file()}
    Trials(replace(config, reference="collision-check"), tmp_path / "old")
    assert {path: path.read_bytes() for path in (tmp_path / "old").rglob("*") if path.is_file()} == before


def test_an_interrupted_run_stops_its_own_processes_and_no_others(config: TrialsConfig, tmp_path: Path) -> None:
    def stop(row: dict[str, Any]) -> None:
        raise KeyboardInterrupt

    other = multiprocessing.get_context("spawn").Process(target=time.sleep, args=(600,), daemon=True)
    other.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            Trials(config, tmp_path).run(workers=2, ended=stop)
        assert multiprocessing.active_children() == [other]
    finally:
        other.kill()
        other.join()


def holds_text(path: Path) -> bool:
    """A file is there before its first line is."""
    return path.exists() and path.stat().st_size > 0


@pytest.mark.parametrize(
    ("blow", "to_all"),
    [(signal.SIGINT, True), (signal.SIGINT, False), (signal.SIGTERM, False), (signal.SIGKILL, False)],
)
def test_a_stopped_run_leaves_readable_files_and_no_process(
    config: TrialsConfig, tmp_path: Path, blow: signal.Signals, to_all: bool
) -> None:
    """A key press reaches the whole group, a signal one process."""
    out = tmp_path / "out"
    arguments = ["--models", config.models, "--scenes", config.scenes, "--out", out, "--budget", "extensions=300"]
    code = "from fairlead.cli.main import main; main()"
    command = [sys.executable, "-c", code, "evaluate", "dragging", *map(str, arguments)]
    command += ["--methods", "collision-check,oracle", "--workers", "2"]
    run = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)
    trace = out / "traces" / "oracle" / "scene-0-0"
    while not ((trace / EVENTS).exists() and holds_text(out / TRIALS)) and run.poll() is None:
        time.sleep(0.02)
    os.killpg(run.pid, blow) if to_all else run.send_signal(blow)
    _, errors = run.communicate(timeout=60)  # returns once no process holds the pipes
    assert run.returncode == (130 if blow is signal.SIGINT else -blow)
    assert "Traceback" not in errors
    rows = list(read_jsonl(out / TRIALS))
    assert {row["method"] for row in rows} == {"collision-check"}
    assert all(set(row) == ROW for row in rows)
    assert read_trace(trace).outcome is TrialOutcome.INTERRUPTED
    assert not (out / MANIFEST).exists()


def test_a_worker_that_dies_ends_the_run_with_a_sentence(config: TrialsConfig, tmp_path: Path) -> None:
    def stop(row: dict[str, Any]) -> None:
        for worker in multiprocessing.active_children():
            worker.kill()

    with pytest.raises(FairleadError, match=r"worker process died \(exit code -9\)"):
        Trials(config, tmp_path).run(workers=1, ended=stop)
    assert len(rows(tmp_path)) == 1


def test_two_runs_do_not_share_a_folder_at_the_same_time(config: TrialsConfig, tmp_path: Path) -> None:
    first, second = Trials(config, tmp_path), Trials(config, tmp_path)

    def run_the_other(row: dict[str, Any]) -> None:
        with pytest.raises(ArtifactError, match="another process"):
            second.run(workers=1)

    first.run(workers=1, ended=run_the_other)
    second.run(workers=1)
    names = [(row["method"], row["scene"], row["seed"]) for row in rows(tmp_path)]
    assert len(names) == len(set(names))


def test_a_finished_folder_stays_as_it_is(config: TrialsConfig, finished: Path) -> None:
    before = {path: path.read_bytes() for path in finished.rglob("*") if path.is_file()}
    assert Trials(config, finished).missing == []
    Trials(config, finished).run()
    assert {path: path.read_bytes() for path in finished.rglob("*") if path.is_file()} == before


def test_traces_are_kept_where_asked(config: TrialsConfig, finished: Path) -> None:
    kept = sorted(path.relative_to(finished / "traces") for path in (finished / "traces").glob("*/*"))
    assert kept == [Path(method, "scene-0-0") for method in sorted(config.methods)]
    trace = read_trace(finished / "traces" / "accept-all" / "scene-0-0")
    (row,) = [row for row in rows(finished) if (row["scene"], row["method"]) == ("scene-0", "accept-all")]
    assert trace.outcome.label == row["outcome"]
    assert len(trace.actions) == row["actions"] == sum(row["action_outcomes"].values())
    assert Counter(action.outcome.label for action in trace.actions) == row["action_outcomes"]
    last = list(views(recording(trace, "accept-all", 0)))[-1]
    assert last.phase == row["outcome"]
    np.testing.assert_allclose(last.state, trace.actions[-1].state)


def test_the_reference_stays_until_another_is_stated(config: TrialsConfig, finished: Path, tmp_path: Path) -> None:
    shutil.copytree(finished, tmp_path / "out")

    def reference(**change: Any) -> str:
        Trials(replace(config, **change), tmp_path / "out").run()
        (comparison,) = read_json(tmp_path / "out" / SUMMARY)["comparisons"]
        assert comparison["method"] == read_manifest(tmp_path / "out", "trials").config["reference"]
        verify_files(tmp_path / "out", read_manifest(tmp_path / "out", "trials"))
        return comparison["method"]

    assert reference() == "accept-all"
    assert reference(reference="collision-check") == "collision-check"
    assert reference() == "collision-check"
    assert reference(methods=("accept-all",)) == "collision-check"
    assert reference(reference="accept-all") == "accept-all"
    with pytest.raises(UnknownNameError, match="reference 'oracle'"):
        reference(reference="oracle")


def test_only_models_that_the_methods_use_belong_to_the_trials(
    config: TrialsConfig, finished: Path, tmp_path: Path
) -> None:
    out, models = tmp_path / "out", tmp_path / "models"
    shutil.copytree(finished, out)
    shutil.copytree(config.models, models)
    shutil.copytree(config.models / "dynamics", models / "another")
    changed = replace(config, models=models)
    assert Trials(changed, out).missing == []
    assert set(read_json(out / CONFIG)["models"]) == {"dynamics"}
    manifest = models / "dynamics" / MANIFEST
    manifest.write_text(manifest.read_text() + "\n")
    with pytest.raises(ArtifactError, match="another model dynamics"):
        Trials(changed, out)
    assert Trials(replace(changed, methods=("oracle",)), out).missing  # needs no model


@pytest.mark.parametrize(
    "change", [{"budget": Budget(seconds=1)}, {"planner": "ompl"}, {"remember": True}, {"distilled": True}]
)
def test_another_configuration_is_refused(config: TrialsConfig, finished: Path, change: dict[str, Any]) -> None:
    with pytest.raises(ArtifactError, match=f"another {next(iter(change))} "):
        Trials(replace(config, **change), finished)
    assert Trials(config, finished).missing == []
    assert (finished / MANIFEST).exists()


def test_a_finished_folder_of_an_earlier_version_stays_as_it_is(
    config: TrialsConfig, finished: Path, tmp_path: Path
) -> None:
    """It does not mention the settings that were added since, and has them off."""
    out = tmp_path / "trials"
    shutil.copytree(finished, out)
    write_json(out / CONFIG, {key: value for key, value in read_json(out / CONFIG).items() if key not in OFF})
    manifest = read_json(out / MANIFEST)
    manifest["files"][CONFIG] = sha256(out / CONFIG)
    write_json(out / MANIFEST, manifest)
    before = {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}
    Trials(config, out).run()
    assert {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()} == before
    with pytest.raises(ArtifactError, match="another distilled"):
        Trials(replace(config, distilled=True), out)


def test_distilled_dynamics_plan_in_the_place_of_the_ensemble(config: TrialsConfig, tmp_path: Path) -> None:
    bench = Bench(replace(config, distilled=True))
    assert set(bench.models.hashes) == {"dynamics", "distilled"}
    dynamics, *_ = Parts(bench.models).build(find_method("accept-all"), bench.scenes.scenes[0])
    assert isinstance(dynamics, LearnedDynamics)
    assert isinstance(dynamics.module, Distilled)
    with pytest.raises(FairleadError, match="--distilled means nothing"):
        replace(config, methods=("oracle",), distilled=True)
    shutil.copytree(config.models / "dynamics", tmp_path / "dynamics")
    with pytest.raises(ArtifactError, match="no finished model; leave out --distilled"):
        Bench(replace(config, models=tmp_path, distilled=True))


def test_a_folder_of_something_else_is_left_as_it_is(config: TrialsConfig, tmp_path: Path) -> None:
    """A model's, whose configuration has the same name; one with a manifest of another kind; anybody's."""
    model = config.models / "dynamics"
    before = {path: path.read_bytes() for path in model.iterdir()}
    with pytest.raises(ArtifactError, match="'trials' is needed here"):
        Trials(config, model)
    assert {path: path.read_bytes() for path in model.iterdir()} == before
    (tmp_path / CONFIG).write_bytes((model / CONFIG).read_bytes())
    with pytest.raises(ArtifactError, match="not the configuration of trials"):
        Trials(config, tmp_path)
    (tmp_path / CONFIG).rename(tmp_path / "notes.txt")
    with pytest.raises(ArtifactError, match="holds no trials"):
        Trials(config, tmp_path)


def test_the_scenes_that_are_given_are_never_replaced(config: TrialsConfig, tmp_path: Path) -> None:
    out = tmp_path / "out"
    Trials(replace(config, limit=1), out).run()
    with pytest.raises(ArtifactError, match="would be replaced"):
        Trials(replace(config, scenes=out / SCENES), out)


def test_a_finished_folder_whose_rows_were_changed_is_named(config: TrialsConfig, tmp_path: Path) -> None:
    out = tmp_path / "out"
    Trials(replace(config, limit=1), out).run()
    (out / TRIALS).write_text((out / TRIALS).read_text().replace('"success": false', '"success": true', 1) + "\n")
    with pytest.raises(ArtifactError, match=TRIALS):
        Trials(replace(config, limit=1), out).run()


def test_timed_trials_have_no_more_processes_than_cores(config: TrialsConfig, tmp_path: Path, monkeypatch) -> None:
    asked = []
    monkeypatch.setattr(trials, "cores", lambda: 2)
    monkeypatch.setattr(trials, "run_jobs", lambda config, jobs, workers: (asked.append(workers), (r for r in ()))[1])
    monkeypatch.setattr(trials, "_finish", lambda *_: {})
    for name, budget in (("timed", Budget(seconds=1)), ("counted", Budget(extensions=1))):
        Trials(replace(config, budget=budget), tmp_path / name).run(workers=5)
    assert asked == [2, 5]


def test_memories_end_with_their_trial_and_planning_knows_its_arms(config: TrialsConfig) -> None:
    config = replace(config, budget=Budget(extensions=2000))
    remembering = Bench(replace(config, remember=True))
    jobs = [Trial("accept-all", name, 0, None) for name in ("scene-0", "scene-1", "scene-0")]
    first, _, again = (remembering.run(job) for job in jobs)
    assert first == again
    assert first["action_outcomes"]["timeout"]
    assert first != Bench(config).run(jobs[0])
    models, scenes = shipped_models("dual_arm"), benchmark_scenes("dual_arm")
    panda = Bench(TrialsConfig("dual_arm", models, scenes, ("collision-check",), Budget(extensions=1),
                               differences=Differences(arms="panda")))  # fmt: skip
    assert panda.models.scenario.arms is not None
    assert not np.array_equal(panda.models.scenario.arms.home, scenario("dual_arm").arms.home)


def test_recovery_that_keeps_a_plan_keeps_it_for_one_trial() -> None:
    method = "trust-sdf+doubted-recovery"  # which asks the planned one, too
    models, scenes = shipped_models("dual_arm"), benchmark_scenes("dual_arm").with_name("dual_arm_hard.json")
    bench = Bench(TrialsConfig("dual_arm", models, scenes, (method,), Budget(extensions=2500)))
    stuck, elsewhere = "draped-2023-013", "caught-2023-012"
    rows = [bench.run(Trial(method, name, 0, None)) for name in (stuck, elsewhere, stuck)]
    assert rows[0] == rows[2]
    assert min(row["recovery_actions"] for row in rows) >= 2


def test_a_missing_model_is_found_before_anything_is_written(config: TrialsConfig, tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match="trust"):
        Trials(replace(config, methods=("accept-all", "trust")), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_every_row_of_the_table_names_parts_that_exist() -> None:
    for method in METHODS.values():
        assert method.dynamics in {*DYNAMICS, "simulator"}
        assert method.check in CHECKS
        assert method.recovery in {*RECOVERIES, "planned", "doubted"}
        assert method.sentence.endswith(".")


def test_mistakes_name_what_is_allowed(config: TrialsConfig) -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'accept-all'"):
        find_method("acept-all")
    with pytest.raises(FairleadError, match="methods"):
        replace(config, methods=("trust", "trust"))
    with pytest.raises(FairleadError, match="seeds"):
        replace(config, seeds=())
    with pytest.raises(FairleadError, match="traced -1"):
        replace(config, traced=-1)
    with pytest.raises(UnknownNameError):
        find_method("collision")  # a check, and no method


def test_an_attempt_is_as_much_longer_as_the_budget(config: TrialsConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[SearchSettings] = []

    def planner(settings: SearchSettings) -> BatchedRRT:
        asked.append(settings)
        return BatchedRRT(settings)

    monkeypatch.setitem(PLANNERS, "rrt", NamedPlanner(planner, ""))
    bench = Bench(replace(config, methods=("oracle", "accept-all"), budget=Budget(extensions=1)))
    for method in bench.config.methods:
        bench.run(Trial(method, "scene-0", 0, None))
    oracle, other = asked
    assert other == PAPER
    assert oracle.attempt_seconds == METHODS["oracle"].budget_scale * PAPER.attempt_seconds
    assert oracle.attempt_extensions == METHODS["oracle"].budget_scale * PAPER.attempt_extensions


@given(st.floats(1, 100), st.floats(1, 10))
def test_scaled_budgets_keep_their_unit(amount: float, factor: float) -> None:
    assert scaled(Budget(seconds=amount), factor) == Budget(seconds=amount * factor)
    assert scaled(Budget(extensions=amount), factor) == Budget(extensions=amount * factor)


@given(
    st.lists(st.dictionaries(st.text(max_size=5), st.integers()), max_size=4), st.text(alphabet='{"a: 1', max_size=9)
)
def test_repair_keeps_whole_lines_and_nothing_else(
    tmp_path_factory: pytest.TempPathFactory, whole: list, rest: str
) -> None:
    path = tmp_path_factory.mktemp("repair") / TRIALS
    for row in whole:
        append_jsonl(path, row)
    with path.open("a") as file:
        file.write(rest)
    repair(path)
    append_jsonl(path, {"new": 1})
    assert list(read_jsonl(path)) == [*whole, {"new": 1}]


def test_another_threshold_of_the_spread_is_refused(config: TrialsConfig, tmp_path: Path) -> None:
    """It comes with a classifier: with another one there, trials that are missing would be others than the rest."""
    models = tmp_path / "models"
    shutil.copytree(config.models / "dynamics", models / "dynamics")
    layout, inputs = scenario("dragging").layout, {"dynamics": sha256(models / "dynamics" / MANIFEST)}
    spread = replace(config, models=models, methods=("spread-threshold",), limit=1, traced=0)
    for name, threshold in (("trust", 0.5), ("trust-sdf", 0.1)):
        job = Job(models / name, "dragging", 0, inputs)
        save_model(job, "trust", "sdf", layout, DynamicsConfig(), {}, {"spread_threshold_m": threshold}, 0.0)
        if name == "trust":
            Trials(spread, tmp_path / "out").run()
    with pytest.raises(ArtifactError, match=r"another spread_threshold_m \(0.5, now 0.1\)"):
        Trials(replace(spread, limit=2), tmp_path / "out")


@pytest.mark.parametrize("file", ["dragging", "dragging_hard", "dual_arm", "dual_arm_hard"])
def test_the_collision_check_accepts_ropes_as_they_lie_in_every_scene(file, tmp_path):
    path = benchmark_scenes("dragging").with_stem(file)
    world = scenario(file.removesuffix("_hard"))
    whole = CHECKS["collision"](Models(tmp_path, world))
    check = whole if world.arms is None else whole.inner
    for scene in world.scenes(path).scenes:
        environment, state = world.environment(scene.obstacles), scene.state(world.layout)[None]
        encoding = check.encode(environment, state)
        still = Transitions(state, np.zeros((1, world.layout.action_size)), state, np.zeros(1))
        assert check.probability(environment, still, encoding, encoding)[0] > 0.5, scene.name
