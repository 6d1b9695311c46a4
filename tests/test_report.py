"""The report: self-contained, complete, the same from the same folders; and a trial's frames tell it in order."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import synthetic
from fairlead.core.artifacts import Manifest, append_jsonl, write_json
from fairlead.core.errors import ArtifactError
from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome, PlanOutcome, SearchTree, TrialOutcome
from fairlead.core.traces import Trace, TracedAction, TracedPlan
from fairlead.evaluation.shipped import benchmark_scenes
from fairlead.evaluation.summary import summarise
from fairlead.learning.model_files import KINDS
from fairlead.report.drawing import outline
from fairlead.report.model_figures import REPORTED, metrics_tables
from fairlead.report.movie import recoveries, takes
from fairlead.report.page import write_report
from fairlead.report.playback import FPS, SPEED, Branches, Episode, Recording, as_predicted, recording, views
from fairlead.report.sections import matrix
from fairlead.report.sources import TrialSet, find_sources, told_apart
from fairlead.report.tables import Table, actions_table, effort_table, error_table, overview_table, success_table
from fairlead.report.video import Panel, frame, within, write_video
from fairlead.report.videos import choose
from fairlead.reproduce.cameras import camera
from fairlead.scenarios.registry import scenario


@pytest.fixture(scope="module")
def trials(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished folder of made-up trials."""
    folder = tmp_path_factory.mktemp("runs") / "made-up"
    rows = synthetic.rows(scenes=6)
    for row in rows:
        append_jsonl(folder / "trials.jsonl", row)
    rng = np.random.default_rng(0)
    write_json(folder / "scenes.json", {"scenes": [synthetic.scene(f"scene-{i:03d}", rng) for i in range(6)]})
    write_json(folder / "summary.json", summarise(rows, tuple(synthetic.RATES), 0))
    config = {"scenario": "dragging", "scenes": "made-up", "budget": "seconds=60", "protocol": "fair", "planner": "rrt"}
    Manifest("trials", config, 0, {}, {}, {}).write(folder)
    return folder


def test_the_page_needs_nothing_beside_it(trials: Path, tmp_path: Path) -> None:
    page = write_report([trials], tmp_path, videos=False).read_text()
    assert re.findall(r'(?:src|href)="(?!data:|#)', page) == []
    assert page.count("<img") == 5
    for method in synthetic.RATES:
        assert f">{method}<" in page


def test_the_same_folders_give_the_same_page(trials: Path, tmp_path: Path) -> None:
    pages = [write_report([trials], tmp_path / name, videos=False).read_bytes() for name in ("a", "b")]
    assert pages[0] == pages[1]


def test_a_manifest_of_somebody_else_is_passed_over(trials: Path, tmp_path: Path) -> None:
    write_json(tmp_path / "theirs" / "manifest.json", ["not", "ours"])
    assert len(find_sources([tmp_path, trials]).trials) == 1


def test_there_is_no_mean_over_sets_of_different_budgets(trials: Path, tmp_path: Path) -> None:
    """Nor does the headline say that one set's numbers are a mean."""
    longer, other = tmp_path / "longer", tmp_path / "other"
    for folder, budget in ((longer, "seconds=180"), (other, "seconds=60")):
        shutil.copytree(trials, folder)
        rows = [{**row, "budget": budget} for row in synthetic.rows(scenes=6)]
        write_json(folder / "summary.json", summarise(rows, tuple(synthetic.RATES), 0))
        about = {"scenario": folder.name, "scenes": "made-up", "budget": budget, "protocol": "fair", "planner": "rrt"}
        Manifest("trials", about, 0, {}, {}, {}).write(folder)
    page, alike = (
        write_report([trials, folder], tmp_path / f"page-{folder.name}", videos=False)
        .with_name("report.md")
        .read_text()
        for folder in (longer, other)
    )
    assert page.startswith("# Planning only through what is trusted")
    assert "Mean success" not in page
    assert "| mean |" not in page
    assert "Mean success and error over 2 sets" in alike
    assert "| mean |" in alike


def test_every_trial_is_a_cell(trials: Path, tmp_path: Path) -> None:
    page = write_report([trials.parent], tmp_path, videos=False).read_text()
    assert page.count('title="scene-') == len(synthetic.rows(scenes=6))


def test_a_column_is_one_scene_and_seed_whatever_else_a_method_lacks(trials: Path, tmp_path: Path) -> None:
    shutil.copytree(trials, tmp_path / "some")
    (tmp_path / "some" / "trials.jsonl").unlink()
    for row in synthetic.rows(scenes=6):
        if row["method"] == "trust" or row["scene"] > "scene-002":
            append_jsonl(tmp_path / "some" / "trials.jsonl", row)
    cells = matrix(TrialSet(tmp_path / "some"))["cells"]
    for column in zip(*cells.values(), strict=True):
        assert len({cell["text"].split(":")[0] for cell in column if cell}) == 1
    assert [cell is None for cell in cells["trust-sdf"]] == [True] * 6 + [False] * 6
    assert None not in cells["trust"]


def test_a_method_of_a_shorter_budget_has_no_success_later() -> None:
    rows = [{**row, "budget": "seconds=30"} if row["method"] == "trust" else row for row in synthetic.rows(scenes=4)]
    table = success_table(summarise(rows, tuple(synthetic.RATES), 0), "seconds=60")
    assert table.columns[-3:] == ("at 15 s", "at 30 s", "at 60 s")
    assert [row[-1] == "-" for row in table.rows] == [True, False, False, False, False]


def test_the_page_names_every_revision_and_machine_of_trials(trials: Path, tmp_path: Path) -> None:
    shutil.copytree(trials, tmp_path / "both")
    manifest = json.loads((tmp_path / "both" / "manifest.json").read_text())
    manifest["extra"] = {"revisions": ["1234567", "abcdef0"], "machines": ["2 x This", "4 x That"]}
    write_json(tmp_path / "both" / "manifest.json", manifest)
    page = write_report([tmp_path / "both"], tmp_path / "page", videos=False).read_text()
    assert "1234567, abcdef0" in page
    assert "2 x This, 4 x That" in page


def test_the_page_tells_how_far_from_their_places_ropes_came_to_rest(trials: Path, tmp_path: Path) -> None:
    shutil.copytree(trials, tmp_path / "laid")
    (tmp_path / "laid" / "trials.jsonl").unlink()
    for number, row in enumerate(synthetic.rows(scenes=6)):
        append_jsonl(tmp_path / "laid" / "trials.jsonl", {**row, "start_residual_m": 0.0125 if not number else 0.002})
    page = write_report([tmp_path / "laid"], tmp_path / "page", videos=False).read_text()
    assert "2.0 mm (median, at most 12.5)" in page
    assert "came to rest" not in write_report([trials], tmp_path / "old", videos=False).read_text()


def test_methods_keep_their_order(trials: Path) -> None:
    (found,) = find_sources([trials]).trials
    assert list(found.rows_of) == list(synthetic.RATES)
    assert [row[0] for row in success_table(found.summary, "seconds=60").rows] == list(synthetic.RATES)


def test_nothing_finished_is_an_error_that_names_the_folder(tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match=str(tmp_path)):
        find_sources([tmp_path])
    with pytest.raises(ArtifactError, match="no such folder"):
        find_sources([tmp_path / "missing"])


def test_markdown_has_one_cell_a_column() -> None:
    table = Table("t", ("a", "b"), (("x|y", "1"), ("z", "2")))
    lines = table.markdown().splitlines()[2:]
    assert {len(re.findall(r"(?<!\\)\|", line)) for line in lines} == {3}


@given(st.floats(-3, 3), st.floats(0.05, 1), st.floats(0.05, 1))
def test_outline_is_the_turned_rectangle(yaw: float, a: float, b: float) -> None:
    box = {"size": [a, b, 1], "position": [0.3, -0.2, 0], "quaternion_xyzw": [0, 0, np.sin(yaw / 2), np.cos(yaw / 2)]}
    corners = outline(box)
    assert corners.mean(axis=0) == pytest.approx([0.3, -0.2])
    sides = np.roll(corners, -1, axis=0) - corners
    assert sorted(np.linalg.norm(sides, axis=1)) == pytest.approx(sorted([a, a, b, b]))
    along = np.abs(sides @ [np.cos(yaw), np.sin(yaw)])
    assert sorted(along) == pytest.approx([0, 0, a, a], abs=1e-6)


def test_the_outline_of_a_box_on_its_side_is_what_is_seen_of_it() -> None:
    half = float(np.sqrt(0.5))
    box = {"size": [0.2, 0.1, 0.6], "position": [0, 0, 0], "quaternion_xyzw": [half, 0, 0, half]}
    assert outline(box).max(axis=0) == pytest.approx([0.1, 0.3])


def made_up_recording(scene: dict[str, Any], steps: tuple[int, ...], rng: np.random.Generator) -> Recording:
    """A rope that moves at random; an episode with no steps was planned and not executed."""
    rope = np.array(scene["rope"])
    layout, episodes = StateLayout(("gripper",), len(rope)), []
    state = layout.join(rope[-1:], rope)
    for count in steps:
        executed = state + np.cumsum(rng.normal(0, 0.01, (count + 1, len(state))), axis=0)
        tree = Branches(rng.normal(0, 0.3, (20, 1, 3)), np.arange(20) // 2, rng.uniform(0.5, 1, 20))
        seconds, trust, errors = (rng.uniform(0.1, 1, n) for n in (count, count, count + 1))
        episodes.append(Episode(True, tree, executed + 0.01, trust, executed, errors, seconds, 0.1))
        state = executed[-1]
    return Recording("made-up", layout, tuple(episodes), "goal", "It is there.")


@given(st.lists(st.integers(0, 4), min_size=1, max_size=3), st.integers(0, 100))
def test_frames_tell_the_trial_in_order(steps: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    recording = made_up_recording(synthetic.scene("s", rng), tuple(steps), rng)
    shown = list(views(recording))
    seconds = [view.seconds for view in shown]
    assert seconds == sorted(seconds)
    total = sum(episode.seconds.sum() + episode.planning_s for episode in recording.episodes)
    assert seconds[-1] == pytest.approx(total)
    assert shown[-1].ended
    assert shown[-1].state == pytest.approx(recording.episodes[-1].executed[-1])
    assert shown[-1].plans == len(steps)


def test_the_clock_of_a_video_counts_what_recoveries_took_to_choose() -> None:
    state, nothing = np.zeros(6, np.float32), np.zeros((0, 6), np.float32)
    tree = SearchTree(nothing, np.zeros(0, np.int32), np.zeros(0, np.float32))
    plans, actions, clock = [], [], 0.0
    for number in range(3):
        clock += 0.5
        plans.append(TracedPlan(number, PlanOutcome.STUCK, clock, 32, nothing, nothing[:, :3], tree.trust, tree))
        clock += 2.0 + 1.0
        actions.append(TracedAction(number, True, np.zeros(3), ActionOutcome.TARGET, 1.0, clock, state, 0.1))
    layout, outcome = StateLayout(("gripper",), 1), TrialOutcome.BUDGET
    told = recording(Trace({}, layout, state, 0.1, tuple(plans), tuple(actions), outcome, {}), "made-up", (0,))
    assert [episode.planning_s for episode in told.episodes] == pytest.approx([0.5, 2.0] * 3)
    *_, last = views(told)
    assert last.seconds == pytest.approx(clock)


@given(st.lists(st.integers(0, 4), min_size=1, max_size=3), st.integers(0, 100))
def test_what_was_foretold_plays_frame_for_frame_beside_what_happened(steps: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    happened = made_up_recording(synthetic.scene("s", rng), tuple(steps), rng)
    foretold = as_predicted(happened, "foretold")
    pairs = list(zip(views(foretold), views(happened), strict=True))
    assert [(a.phase, a.seconds, a.plans) for a, _ in pairs] == [(b.phase, b.seconds, b.plans) for _, b in pairs]
    for told, episode in zip(foretold.episodes, happened.episodes, strict=True):
        assert told.executed == pytest.approx(episode.executed + 0.01)  # as the recording was made up
        assert told.errors == pytest.approx(np.sqrt(3) * 0.01)


@given(st.integers(1, 2000), st.sampled_from([1.0, 3.0, 20.0]))
def test_a_long_trial_plays_faster_and_to_its_end(count: int, longest_s: float) -> None:
    frames: list[list[Any]] = [[number] for number in range(count)]
    shown, speed = within(frames, longest_s)
    assert len(shown) <= longest_s * FPS + 1
    assert (shown[0], shown[-1]) == (frames[0], frames[-1])
    assert speed == SPEED * max(1, shown[1][0] if len(shown) > 2 else 1)


def test_several_sets_of_trials_are_seen_at_a_glance() -> None:
    one, two = (summarise(synthetic.rows(scenes), tuple(synthetic.RATES), 0) for scenes in (4, 8))
    only = {**two, "order": ["trust"], "methods": {"trust": two["methods"]["trust"]}}
    table = overview_table({"one": one, "two": two})
    assert [row[0] for row in table.rows] == ["one", "two", "mean"]
    rates = [100 * found["methods"]["trust"]["success"]["value"] for found in (one, two)]
    shown = [float(row[table.columns.index("trust")].split(" %")[0]) for row in table.rows]
    assert shown == pytest.approx([*rates, np.mean(rates)], abs=0.51)
    partly = overview_table({"one": one, "only": only})
    assert partly.rows[1][partly.columns.index("accept-all")] == "-"
    assert partly.rows[-1][partly.columns.index("accept-all")] == "-"
    other = {**two, "order": ["accept-all"], "reference": "accept-all",
             "methods": {"accept-all": two["methods"]["accept-all"]}}  # fmt: skip
    assert [row[0] for row in overview_table({"only": only, "other": other}).rows] == ["only", "other"]


def test_a_method_with_fewer_trials_than_others_is_marked() -> None:
    """Its numbers are of other scenes: they stand beside the others' only with a warning, and in no overview."""
    rows = [row for row in synthetic.rows(4, 1) if row["method"] != "trust" or row["scene"] < "scene-002"]
    summary = summarise(rows, tuple(synthetic.RATES), 0)
    named = [row[0] for table in (error_table(summary, ""), effort_table(summary), actions_table(summary))
             for row in table.rows]  # fmt: skip
    assert named.count("trust (only 2 of 4 trials)") == named.count("trust-sdf") == 3
    overview = overview_table({"one": summary, "two": summary})
    assert {row[overview.columns.index("trust")] for row in overview.rows} == {"-"}
    assert "-" not in [row[overview.columns.index("trust-sdf")] for row in overview.rows]


def test_video_is_written_and_its_frames_are_not_empty(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    scene = synthetic.scene("s", rng)
    cameras = None, FakeCamera()
    panels = [Panel(made_up_recording(scene, (1,), rng), scene, (0,), camera) for camera in cameras]
    write_video(tmp_path / "v.mp4", panels)
    assert (tmp_path / "v.mp4").read_bytes()[4:8] == b"ftyp"
    last = [list(views(panel.recording))[-1] for panel in panels]
    assert len(np.unique(np.asarray(frame(panels, last)).reshape(-1, 3), axis=0)) > 50
    assert cameras[1].taken < len(list(views(panels[1].recording)))


class FakeCamera:
    """Counts its pictures."""

    taken = 0

    def frame(self, state: np.ndarray, ghost: np.ndarray | None = None) -> np.ndarray:
        self.taken += 1
        return np.full((64, 64, 3), 128, np.uint8)

    def project(self, points: np.ndarray) -> np.ndarray:
        return points[:, :2]


def test_points_are_where_the_camera_shows_them() -> None:
    """A gripper's red dot is drawn where its position is projected to."""
    world = scenario("dual_arm")
    scene = world.scenes(benchmark_scenes("dual_arm")).scenes[0]
    with camera({"scenario": "dual_arm"}, scene.written(), 200) as found:
        if found is None:
            pytest.skip("nothing can be rendered here: fairlead doctor says what is missing")
        picture, state = found.frame(scene.state(world.layout)), scene.state(world.layout)
        for x, y in (found.project(world.layout.grippers_of(state)) * 200).astype(int):
            near = picture[y - 2 : y + 3, x - 2 : x + 3].reshape(-1, 3).astype(int)
            assert (near[:, 0] > near[:, 1:].max(axis=1) + 60).any()


def test_trials_without_their_scenes_are_told_without_pictures_of_them(trials: Path, tmp_path: Path) -> None:
    """Rows may travel where scenes may not."""
    shutil.copytree(trials, tmp_path / "rows")
    (tmp_path / "rows" / "scenes.json").unlink()
    (tmp_path / "rows" / "traces" / "trust" / "scene-000-0").mkdir(parents=True)
    page = write_report([tmp_path / "rows"], tmp_path / "page")
    assert "no pictures of them" in page.read_text()
    names = {path.name for path in (page.parent / "figures").iterdir()}
    assert any(name.endswith("-threshold.svg") for name in names)
    assert not any(name.endswith("-scenes.svg") for name in names)


def test_the_arms_that_carry_a_trial_out_are_drawn() -> None:
    """Where other arms than those of training execute, pictures show the others."""
    world = scenario("dual_arm")
    scene = world.scenes(benchmark_scenes("dual_arm")).scenes[0]
    pictures = []
    for differences in ("", "friction=0.5", "arms=panda"):
        with camera({"scenario": "dual_arm", "differences": differences}, scene.written(), 200) as found:
            if found is None:
                pytest.skip("nothing can be rendered here: fairlead doctor says what is missing")
            pictures.append(found.frame(scene.state(world.layout)))
    same, panda = (np.abs(pictures[0].astype(int) - other).max(axis=2) > 60 for other in pictures[1:])
    assert not same.any()
    assert panda.mean() > 0.02


def test_a_movie_shows_first_what_tells_most(trials: Path, tmp_path: Path) -> None:
    """Scenes where only the reference succeeds come first; a recovery is one that led to the goal, if any did."""
    folder = tmp_path / "told"
    shutil.copytree(trials, folder)
    rows = [row for row in synthetic.rows(scenes=6, seeds=1) if row["method"] in ("trust", "accept-all")]
    told = {"trust": [0, 1, 1, 1, 0, 1], "accept-all": [1, 1, 0, 1, 0, 0]}
    (folder / "trials.jsonl").unlink()
    for row in rows:
        number = int(row["scene"][-3:])
        row |= {"success": bool(told[row["method"]][number]), "recovery_actions": 2 if number in (0, 3) else 0}
        append_jsonl(folder / "trials.jsonl", row)
        (folder / "traces" / row["method"] / f"{row['scene']}-{row['seed']}").mkdir(parents=True)
    found = TrialSet(folder)
    assert found.reference == "trust"
    assert [int(take.scene[-3:]) for take in takes(found, 4)] == [2, 5, 1, 3]
    assert takes(found, 6)[-1].caption.startswith("only the right one")
    assert [take.scene for take in recoveries(found, ())] == ["scene-003"]


@pytest.mark.parametrize("reference_fails", [True, False])
def test_the_page_shows_a_recovery_and_a_failed_one(trials: Path, tmp_path: Path, reference_fails: bool) -> None:
    """Of the reference if there is one, else of another method; each trial alone is shown once."""
    folder = tmp_path / "told"
    shutil.copytree(trials, folder)
    (folder / "trials.jsonl").unlink()
    recovered = {"trust": {2: True, 3: not reference_fails}, "accept-all": {}, "collision-check": {4: False}}
    for row in synthetic.rows(scenes=6, seeds=1):
        if row["method"] not in recovered:
            continue
        number, ends = int(row["scene"][-3:]), recovered[row["method"]]
        row |= {"success": ends.get(number, number < 2), "recovery_actions": 5 * (number in ends), "times_stuck": 2}
        append_jsonl(folder / "trials.jsonl", row)
        (folder / "traces" / row["method"] / f"{row['scene']}-{row['seed']}").mkdir(parents=True)
    found = choose(TrialSet(folder))
    alone = [(choice.methods[0], int(choice.key[0][-3:])) for choice in found if len(choice.methods) == 1]
    rest = [("trust", 3), ("trust", 2)] if reference_fails else [("trust", 4), ("trust", 2), ("collision-check", 4)]
    assert alone[1:] == rest
    told = [key for key, choice in zip(alone, found[-len(alone) :], strict=True) if "5 recovery" in choice.caption]
    assert set(told) == {("trust", 2), rest[0] if reference_fails else rest[2]}
    assert len(set(alone)) == len(alone)


def test_report_says_what_it_made(trials: Path, tmp_path: Path) -> None:
    write_report([trials], tmp_path, videos=False)
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    assert manifest["kind"] == "report"
    assert {"report.html", "report.md"} <= set(manifest["files"])


def test_a_second_report_keeps_nothing_of_the_first_and_everything_else(trials: Path, tmp_path: Path) -> None:
    write_report([trials], tmp_path, videos=False)
    notes = tmp_path / "notes.txt"
    notes.write_text("mine")
    other = trials.parent / "other"
    shutil.copytree(trials, other)
    try:
        write_report([other], tmp_path, videos=False)
    finally:
        shutil.rmtree(other)
    found = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    assert found == {*manifest["files"], "manifest.json", "notes.txt"}
    assert not any("made-up" in name for name in found)
    assert notes.read_text() == "mine"


def test_a_report_does_not_take_the_place_of_something_else(trials: Path) -> None:
    before = (trials / "manifest.json").read_bytes()
    with pytest.raises(ArtifactError, match="'report' is needed"):
        write_report([trials], trials, videos=False)
    assert (trials / "manifest.json").read_bytes() == before
    assert not (trials / "report.html").exists()


def test_the_reference_leads_the_page_and_is_explained(trials: Path, tmp_path: Path) -> None:
    folder = tmp_path / "stated"
    shutil.copytree(trials, folder)
    order = tuple(synthetic.RATES)
    write_json(folder / "summary.json", summarise(synthetic.rows(scenes=6), order, 0, stated="trust-sdf"))
    write_report([folder], tmp_path / "report", videos=False)
    text = (tmp_path / "report" / "report.md").read_text()
    assert text.splitlines()[2].startswith("trust-sdf reaches the goal")
    assert "trust-sdf is the reference: it was asked for." in text
    assert "| trust-sdf vs trust |" in text


def test_an_untrained_recovery_is_called_that(tmp_path: Path) -> None:
    examined = {name: {"examined": 3000, "stuck": 14} for name in ("train", "validation", "test")}
    labels = {"0": 5, "below 1/2": 4, "1/2 and above": 3, "1": 2}
    learned = {name: {**found, "labels": labels, "log_loss": 0.25} for name, found in examined.items()}
    for name, metrics in (("recovery", {"trained": False, **examined}), ("recovery-sdf", {"trained": True, **learned})):
        write_json(tmp_path / name / "metrics.json", metrics)
        Manifest("model", {"kind": "recovery", "config": name}, 0, {}, {}, {}).write(tmp_path / name)
    write_report([tmp_path], tmp_path / "report", videos=False)
    text = (tmp_path / "report" / "report.md").read_text()
    assert "recovery was NOT trained and acts at random: 14 stuck states in 3,000 (train)" in text
    assert "recovery-sdf was NOT" not in text
    assert "| recovery-sdf, test | 3,000 | 14 | 5 | 4 | 3 | 2 | 0.250 |" in text


def test_what_was_learned_stands_beside_the_papers_numbers(tmp_path: Path) -> None:
    """Of the scenario that a model is of; what the paper does not tell is left open."""
    judged = {"accuracy": 0.9, "precision": 0.8, "recall": None, "auroc": 0.95, "reliability": []}
    metrics = {"test": judged, "delta_m": 0.03, "rules": {"figure": {"examples": 1200, "reliable": 0.75}}}
    for name in ("dragging", "dual_arm", "fetch_cable"):
        folder = tmp_path / name / "trust"
        write_json(folder / "metrics.json", metrics)
        Manifest("model", {"kind": "trust", "scenario": name}, 0, {}, {}, {}).write(folder)
    first, second, *others = metrics_tables(find_sources([tmp_path]).models)
    assert [table.title for table in (first, second)] == ["dragging, beside the paper", "dual_arm, beside the paper"]
    assert [table.title for table in others] == ["trust"]
    assert first.rows[:3] == (
        ("dragging/trust: accuracy", "0.9", "0.835"),
        ("dragging/trust: precision", "0.8", "0.888"),
        ("dragging/trust: recall", "-", "0.789"),
    )
    assert second.rows[0] == ("dual_arm/trust: accuracy", "0.9", "0.89")
    assert first.rows[-1][1] == "1,200, 75 % reliable"


def test_how_actions_ended_is_counted_over_trials_and_shown_as_shares() -> None:
    rows = [{**row, "action_outcomes": {"target": 3, "joint_limit": 1}} for row in synthetic.rows(2, 1, ("trust",))]
    summary = summarise(rows, ("trust",), 0)
    assert summary["methods"]["trust"]["action_outcomes"] == {"target": 6, "joint_limit": 2}
    table = actions_table(summary)
    assert table.columns == ("method", "actions", "target", "joint limit")
    assert table.rows == (("trust", "8", "75.0 %", "25.0 %"),)


def test_sets_of_trials_of_one_name_are_told_apart(tmp_path: Path) -> None:
    folders = [tmp_path / of for of in ("desk/trials/hard", "dual/trials/hard", "desk/trials/easy", "hard")]
    names = told_apart(folders, "-")
    assert names[:3] == ["desk-trials-hard", "dual-trials-hard", "easy"]
    assert len(set(names)) == 4


def test_a_page_over_two_lines_keeps_the_figures_of_both(trials: Path, tmp_path: Path) -> None:
    lines = [tmp_path / line for line in ("desk", "dual")]
    for line in lines:
        shutil.copytree(trials, line / "trials" / "benchmark")
    page = write_report(lines, tmp_path / "report", videos=False).read_text()
    assert page.count("<img") == 2 * 5
    manifest = json.loads((tmp_path / "report" / "manifest.json").read_text())
    assert len(manifest["inputs"]) == 2
    assert sum(name.startswith("figures/") for name in manifest["files"]) == 2 * 5


def test_the_page_knows_what_to_report_of_each_kind_of_model() -> None:
    assert set(REPORTED) == set(KINDS)
