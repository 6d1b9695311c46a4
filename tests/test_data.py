"""Laws of collection and of the dataset on disk, on a scenario without physics."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fairlead.core import artifacts
from fairlead.core.artifacts import MANIFEST, alone, read_manifest, sha256
from fairlead.core.errors import ArtifactError, FairleadError
from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome
from fairlead.core.workers import travels
from fairlead.data import recording
from fairlead.data.collect import CollectConfig, collect
from fairlead.data.recording import PROGRESS
from fairlead.data.shards import SPLITS, Shard, read_shard, schema, split_of
from fairlead.data.store import SCENES, load, scenes_from_json, shards_of
from fairlead.data.verify import info, verify
from fairlead.scenarios.dragging import Dragging
from fairlead.scenarios.registry import SCENARIOS
from fairlead.scenarios.registry import scenario as find_scenario
from fakes import LAYOUT, LINK, FakeScenario

CONFIG = CollectConfig(phase=2, trajectories=16 * 9 + 3, seed=5, lanes=16, steps=6)


@pytest.fixture(autouse=True)
def _fake_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SCENARIOS, "fake", FakeScenario)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data") / "whole"
    collect(FakeScenario(), CONFIG, folder)
    return folder


def contents(folder: Path) -> dict[str, str]:
    """Hashes of everything but the manifest, which also says when and where it was made."""
    return {path.name: sha256(path) for path in folder.iterdir() if path.name != MANIFEST}


def all_shards(folder: Path) -> list[Shard]:
    return [shard for _, shard in shards_of(folder, read_manifest(folder, "dataset"))]


def test_every_trajectory_is_there_once_in_one_split(dataset: Path) -> None:
    splits = load(dataset, FakeScenario()).values()
    assert sum(map(len, splits)) == CONFIG.trajectories
    episodes = np.concatenate([shard.episode for shard in all_shards(dataset)])
    assert sorted(episodes) == list(range(CONFIG.trajectories))
    assert verify(dataset)["transitions"] == CONFIG.trajectories * CONFIG.steps


@pytest.mark.parametrize(("count", "fragile"), [(37, 0.0), (133, 0.0), (133, 0.1)])
def test_the_first_trajectories_are_what_a_shorter_recording_holds(tmp_path: Path, count: int, fragile: float) -> None:
    """Also where obstacles moved in between, and where some diverged."""
    config = replace(CONFIG, obstacles_every=2)
    for name, trajectories in (("long", config.trajectories), ("short", count)):
        collect(FakeScenario(fragile), replace(config, trajectories=trajectories), tmp_path / name)
    if fragile:
        assert read_manifest(tmp_path / "short", "dataset").extra["diverged"]
    whole, alone = (load(tmp_path / name, FakeScenario(), n) for name, n in (("long", count), ("short", None)))
    for split in SPLITS:
        part, short = whole[split], alone[split]
        assert len(part.environments) == len(short.environments) == len(np.unique(part.scene))
        for name in ("states", "actions", "outcomes"):
            np.testing.assert_array_equal(getattr(part, name), getattr(short, name))
        held = [[data.environments[scene].boxes for scene in data.scene] for data in (part, short)]
        assert held[0] == held[1]


@pytest.mark.parametrize("first", [0, CONFIG.trajectories + 1])
def test_no_more_trajectories_are_read_than_there_are(dataset: Path, first: int) -> None:
    with pytest.raises(ArtifactError, match=f"first {first} trajectories .* there are {CONFIG.trajectories}"):
        load(dataset, FakeScenario(), first)


def test_no_scene_and_no_lane_is_in_two_splits(dataset: Path) -> None:
    scenes = [{int(i) for s in all_shards(dataset) for i in s.scene[s.split == split]} for split in SPLITS]
    assert all(scenes)
    assert sum(map(len, scenes)) == len(set.union(*scenes))
    for shard in all_shards(dataset):
        assert [split_of(lane) for lane in shard.lane] == shard.split.tolist()


def test_lanes_go_on_without_a_reset_and_obstacles_move_every_eighth_trajectory(dataset: Path) -> None:
    shards = all_shards(dataset)
    for index, (before, after) in enumerate(pairwise(shards), 1):
        count = len(after.lane)
        np.testing.assert_array_equal(before.states[:count, -1], after.states[:, 0])
        assert (before.scene[:count] == after.scene).all() == (index % 8 != 0)


def test_obstacles_are_drawn_clear_of_the_rope(dataset: Path) -> None:
    scenes = scenes_from_json(dataset / SCENES, json.loads((dataset / SCENES).read_text()))
    for index in (0, 8):
        shard = all_shards(dataset)[index]
        for scene, state in zip(shard.scene, shard.states[:, 0], strict=True):
            distance = FakeScenario().environment(scenes[scene]).signed_distance(state.astype(float).reshape(-1, 3))
            assert distance.min() > 0.019


def test_a_displacement_repeats_four_times_of_five_but_never_after_a_block(tmp_path: Path) -> None:
    collect(FakeScenario(), CollectConfig(2, 64, lanes=64, steps=50), tmp_path / "d")
    (shard,) = all_shards(tmp_path / "d")
    wanted = shard.actions - LAYOUT.grippers_of(shard.states[:, :-1])[:, :, 0]
    inside = (np.abs(shard.actions) < 0.899).all(axis=-1)  # a target at the edge was clipped, and its displacement
    comparable = inside[:, 1:] & inside[:, :-1]
    same = np.abs(np.diff(wanted, axis=1)).max(axis=-1) < 1e-5
    blocked = shard.outcomes[:, :-1] == ActionOutcome.TIMEOUT.number
    assert blocked.sum() > 10
    assert not same[blocked].any()
    assert 0.75 < same[comparable & ~blocked].mean() < 0.85


def test_a_diverged_trajectory_is_dropped_counted_and_its_lane_starts_afresh(tmp_path: Path) -> None:
    manifest = collect(FakeScenario(fragile=0.7), CONFIG, tmp_path / "d")
    assert manifest.extra["diverged"] > 5
    assert manifest.extra["diverged"] + manifest.extra["trajectories"] == CONFIG.trajectories
    assert "diverged" not in manifest.extra["outcomes"]
    shards = all_shards(tmp_path / "d")
    for before, after in pairwise(shards):
        fresh = ~np.isin(after.lane, before.lane)
        assert not np.isin(after.scene[fresh], before.scene).any()
    verify(tmp_path / "d")


def test_a_phase_1_dataset_has_no_obstacles_and_other_draws(tmp_path: Path, dataset: Path) -> None:
    collect(FakeScenario(), CollectConfig(1, 16, seed=5, lanes=16, steps=6), tmp_path / "d")
    assert json.loads((tmp_path / "d" / SCENES).read_text()) == [[]]
    one, two = (all_shards(folder)[0] for folder in (tmp_path / "d", dataset))
    first = [shard.actions[:, 0, :2] - shard.states[:, 0, :2] for shard in (one, two)]
    assert np.abs(first[0] - first[1]).max(axis=1).min() > 1e-4


def test_fewer_trajectories_than_lanes(tmp_path: Path) -> None:
    manifest = collect(FakeScenario(), CollectConfig(1, 3), tmp_path / "d")
    assert manifest.extra["trajectories"] == 3
    with pytest.raises(ArtifactError, match="at least eight lanes"):
        load(tmp_path / "d", FakeScenario())


def test_a_finished_dataset_is_left_as_it_is_and_another_configuration_is_refused(dataset: Path) -> None:
    before = {path.name: path.stat().st_mtime_ns for path in dataset.iterdir()}
    collect(FakeScenario(), CONFIG, dataset)
    assert before == {path.name: path.stat().st_mtime_ns for path in dataset.iterdir()}
    with pytest.raises(ArtifactError, match="seed is 5, not 6"):
        collect(FakeScenario(), CollectConfig(2, CONFIG.trajectories, 6, 16, 6), dataset)


def test_a_folder_with_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("")
    with pytest.raises(ArtifactError, match="not empty"):
        collect(FakeScenario(), CONFIG, tmp_path)


def interrupt_after(transitions: int) -> Callable[[int], None]:
    left = [transitions]

    def advance(count: int) -> None:
        left[0] -= count
        if left[0] < 0:
            raise KeyboardInterrupt

    return advance


@pytest.mark.parametrize("stop", [1, 40, 300, 700])
def test_an_interrupted_run_goes_on_to_the_same_bytes(tmp_path: Path, dataset: Path, stop: int) -> None:
    with pytest.raises(KeyboardInterrupt):
        collect(FakeScenario(), CONFIG, tmp_path / "d", advance=interrupt_after(stop))
    with pytest.raises(ArtifactError, match="not a finished dataset"):
        load(tmp_path / "d", FakeScenario())
    collect(FakeScenario(), CONFIG, tmp_path / "d")
    assert contents(tmp_path / "d") == contents(dataset)


@pytest.mark.parametrize(("count", "fragile"), [(CONFIG.trajectories, 0.0), (133, 0.1)])
def test_several_processes_write_the_same_bytes_and_tell_of_as_many(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: int, fragile: float
) -> None:
    config, told = replace(CONFIG, trajectories=count, obstacles_every=4), {"one": 0, "several": 0}
    monkeypatch.setattr("fairlead.data.collect.GROUP", 6)
    for name, threads in (("one", 1), ("several", 2)):

        def advance(more: int, name: str = name) -> None:
            told[name] += more

        collect(FakeScenario(fragile), config, tmp_path / name, threads, advance)
    assert contents(tmp_path / "one") == contents(tmp_path / "several")
    assert told["one"] == told["several"] == config.steps * count
    assert bool(fragile) == bool(read_manifest(tmp_path / "several", "dataset").extra["diverged"])


def test_several_processes_interrupted_go_on_to_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, dataset: Path
) -> None:
    monkeypatch.setattr("fairlead.data.collect.GROUP", 8)
    with pytest.raises(KeyboardInterrupt):
        collect(FakeScenario(), CONFIG, tmp_path / "d", 2, interrupt_after(700))
    assert not multiprocessing.active_children()
    collect(FakeScenario(), CONFIG, tmp_path / "d")
    assert contents(tmp_path / "d") == contents(dataset)


def test_one_process_at_a_time_records_into_a_folder(tmp_path: Path) -> None:
    with alone(tmp_path / "d"), pytest.raises(ArtifactError, match="another process"):
        collect(FakeScenario(), CONFIG, tmp_path / "d")
    assert list((tmp_path / "d").iterdir()) == []


def test_a_scenario_that_cannot_travel_stays_in_one_process(tmp_path: Path, dataset: Path) -> None:
    scenario: Any = FakeScenario()
    scenario.hook = lambda: None
    assert not travels(scenario)
    collect(scenario, replace(CONFIG, lanes=64), tmp_path / "d", threads=2)
    collect(FakeScenario(), replace(CONFIG, lanes=64), tmp_path / "alone")
    assert contents(tmp_path / "d") == contents(tmp_path / "alone")


@pytest.mark.parametrize("name", sorted(SCENARIOS))
def test_scenarios_travel_to_other_processes(name: str) -> None:
    assert travels(find_scenario(name))


def test_a_worker_that_dies_ends_the_recording_with_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def advance(_: int) -> None:
        for worker in multiprocessing.active_children():
            worker.kill()

    monkeypatch.setattr("fairlead.data.collect.GROUP", 8)
    with pytest.raises(FairleadError, match=r"worker process died \(exit code -9\); the same command goes on"):
        collect(FakeScenario(), replace(CONFIG, steps=400), tmp_path / "d", 2, advance)
    assert not multiprocessing.active_children()


def test_resuming_verifies_hashes(tmp_path: Path, dataset: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        collect(FakeScenario(), CONFIG, tmp_path / "d", advance=interrupt_after(600))
    damaged = tmp_path / "d" / "shard-00002.parquet"
    damaged.write_bytes(damaged.read_bytes()[:-5])
    collect(FakeScenario(), CONFIG, tmp_path / "d")
    assert contents(tmp_path / "d") == contents(dataset)


@pytest.mark.parametrize("after", [False, True])
def test_stopped_before_or_after_any_write_it_goes_on_to_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, after: bool
) -> None:
    config = CollectConfig(phase=2, trajectories=11, lanes=4, steps=2, obstacles_every=2)
    collect(FakeScenario(fragile=0.7), config, tmp_path / "whole")
    write, left = artifacts.write_atomic, [0]

    def stopping(path: Path, content: bytes | str) -> None:
        left[0] -= 1
        if left[0] == 0 and not after:
            raise KeyboardInterrupt
        write(path, content)
        if left[0] == 0:
            raise KeyboardInterrupt

    for module in (artifacts, recording):
        monkeypatch.setattr(module, "write_atomic", stopping)
    stops = 0
    for count in range(1, 99):
        left[0] = count
        try:
            collect(FakeScenario(fragile=0.7), config, tmp_path / str(count))
        except KeyboardInterrupt:
            stops += 1
            collect(FakeScenario(fragile=0.7), config, tmp_path / str(count))
        assert contents(tmp_path / str(count)) == contents(tmp_path / "whole")
        if left[0] > 0:
            break
    assert stops > 7


RUN = """
import sys
from pathlib import Path
from fakes import FakeScenario
from fairlead.data.collect import collect
from test_data import CONFIG
collect(FakeScenario(), CONFIG, Path(sys.argv[1]))
"""


def test_killed_at_random_moments_the_run_ends_in_the_same_bytes(tmp_path: Path, dataset: Path) -> None:
    rng, folder, kills = np.random.default_rng(0), tmp_path / "d", 0
    path = os.pathsep.join(filter(None, [str(Path(__file__).parent), os.environ.get("PYTHONPATH")]))
    environment = os.environ | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1"}
    finished = False
    while not finished:
        before = len(list(folder.glob("shard-*")))
        process = subprocess.Popen([sys.executable, "-c", RUN, str(folder)], env=environment)
        if kills < 5:
            while process.poll() is None and len(list(folder.glob("shard-*"))) <= before:
                time.sleep(0.001)
            time.sleep(rng.uniform(0, 0.03))
            process.send_signal(signal.SIGKILL)
        assert process.wait() in (0, -signal.SIGKILL), "the run ended by itself, with an error"
        finished = process.returncode == 0
        kills += not finished
    assert kills > 1
    assert contents(folder) == contents(dataset)
    assert not (folder / PROGRESS).exists()


@given(
    lanes=st.integers(0, 5),
    steps=st.integers(1, 4),
    seed=st.integers(0, 99),
)
def test_a_shard_survives_the_round_trip_and_its_bytes_are_its_contents(
    tmp_path_factory: pytest.TempPathFactory, lanes: int, steps: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    shard = Shard(
        episode=rng.integers(0, 1000, lanes),
        lane=rng.integers(0, 64, lanes),
        scene=rng.integers(0, 9, lanes),
        split=rng.choice(SPLITS, lanes),
        states=rng.normal(size=(lanes, steps + 1, LAYOUT.state_size)).astype(np.float32),
        actions=rng.normal(size=(lanes, steps, LAYOUT.action_size)).astype(np.float32),
        seconds=rng.random((lanes, steps)).astype(np.float32),
        outcomes=rng.integers(0, len(ActionOutcome), (lanes, steps)),
    )
    path = tmp_path_factory.mktemp("shard") / "shard.parquet"
    path.write_bytes(shard.to_bytes(LAYOUT))
    read = read_shard(path, LAYOUT, steps)
    for name in shard.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(read, name), getattr(shard, name), err_msg=name)
    assert read.to_bytes(LAYOUT) == path.read_bytes()
    assert pq.read_schema(path).names == schema(LAYOUT).names


def rewrite(folder: Path, name: str, shard: Shard) -> None:
    """Replace a shard, with a manifest that vouches for it."""
    (folder / name).write_bytes(shard.to_bytes(LAYOUT))
    manifest = json.loads((folder / MANIFEST).read_text())
    manifest["files"][name] = sha256(folder / name)
    (folder / MANIFEST).write_text(json.dumps(manifest))


@pytest.fixture
def small(tmp_path: Path) -> Path:
    collect(FakeScenario(), CollectConfig(2, 16, lanes=8, steps=3), tmp_path / "d")
    return tmp_path / "d"


def test_data_in_which_everything_diverged_are_none(tmp_path: Path) -> None:
    for _ in range(2):
        with pytest.raises(ArtifactError, match="all 16 trajectories diverged"):
            collect(FakeScenario(fragile=9.0), CollectConfig(1, 16, lanes=8, steps=3), tmp_path / "d")
    assert not (tmp_path / "d" / MANIFEST).exists()


def test_data_of_another_rope_are_refused(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    longer = FakeScenario()
    longer.layout = StateLayout(longer.layout.grippers, longer.layout.points + 1)
    with pytest.raises(ArtifactError, match="its states are "):
        load(small, longer)
    monkeypatch.setattr("fairlead.data.verify.find_scenario", lambda name: longer)
    with pytest.raises(ArtifactError, match="its states are "):
        verify(small)


def test_verify_names_a_truncated_shard(small: Path) -> None:
    path = small / "shard-00001.parquet"
    path.write_bytes(path.read_bytes()[:100])
    for read in (verify, lambda folder: load(folder, FakeScenario())):
        with pytest.raises(ArtifactError, match=r"shard-00001\.parquet: damaged"):
            read(small)
    manifest = json.loads((small / MANIFEST).read_text())
    manifest["files"][path.name] = sha256(path)
    (small / MANIFEST).write_text(json.dumps(manifest))
    with pytest.raises(ArtifactError, match=r"shard-00001\.parquet: not a readable shard"):
        verify(small)


@pytest.mark.parametrize(
    ("value", "problem"),
    [
        (np.nan, "not finite"),
        (3.0, "outside the scenario's bounds"),
        (1.02, "outside the scenario's bounds"),
        (None, "stretched"),
    ],
)
def test_verify_names_the_step_of_an_impossible_state(small: Path, value: float | None, problem: str) -> None:
    shard = all_shards(small)[0]
    if value is None:
        shard.states[4, 2, 3:5] = shard.states[4, 2, 6:8] + 1.05 * LINK / np.sqrt(2)
    else:
        shard.states[4, 2, 3] = value
    rewrite(small, "shard-00000.parquet", shard)
    with pytest.raises(ArtifactError, match=rf"shard-00000\.parquet: episode 4, step 2: .*{problem}"):
        verify(small)


def test_verify_counts(small: Path) -> None:
    manifest = json.loads((small / MANIFEST).read_text())
    manifest["extra"]["trajectories"] += 1
    (small / MANIFEST).write_text(json.dumps(manifest))
    with pytest.raises(ArtifactError, match="the shards hold trajectories 16, the manifest says 17"):
        verify(small)


def test_info_needs_the_manifest_alone(small: Path) -> None:
    for path in small.glob("shard-*"):
        path.unlink()
    found = info(small)
    assert (found["trajectories"], found["shards"], found["scenario"]) == (16, 2, "fake")


def test_mistakes_are_named(small: Path) -> None:
    with pytest.raises(ArtifactError, match="scenario 'fake'; one of 'dragging'"):
        load(small, Dragging())
    for wrong in ({"phase": 3}, {"trajectories": 0}, {"lanes": 0}, {"steps": -1}):
        with pytest.raises(FairleadError, match=next(iter(wrong))):
            CollectConfig(**{"phase": 1, "trajectories": 8} | wrong)
