"""The command line: what it says, its exit codes, and one line for a user's mistake."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from importlib import import_module
from pathlib import Path

import pytest

from fairlead.cli import main as cli
from fairlead.data.collect import CollectConfig, collect
from fairlead.evaluation.methods import METHODS
from fairlead.evaluation.planners import PLANNERS
from fairlead.evaluation.shipped import shipped_models
from fairlead.scenarios.registry import SCENARIOS
from fakes import FakeScenario


def call(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["fairlead", *map(str, arguments)])
    try:
        cli.main()
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


@pytest.fixture
def dataset(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setitem(SCENARIOS, "fake", FakeScenario)
    collect(FakeScenario(), CollectConfig(2, 16, lanes=8, steps=3), tmp_path / "d")
    return tmp_path / "d"


def test_help_lists_every_command_and_imports_no_engine() -> None:
    heavy = (
        "import sys; from fairlead.cli.main import run; run(['--help']); print({'torch', 'mujoco'} & set(sys.modules))"
    )
    out = subprocess.run([sys.executable, "-c", heavy], capture_output=True, text=True, check=True).stdout
    assert all(f"\n  {name} " in out for name in cli.COMMANDS)
    assert out.endswith("set()\n")


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_every_command_has_help_and_refuses_what_it_does_not_know(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert import_module(f"fairlead.cli.{name}").Command
    assert call(monkeypatch, name, "--help") == 0
    assert f"fairlead {name}" in capsys.readouterr().out
    assert call(monkeypatch, name, "--no-such-option") == 2


def test_collect_info_and_verify_agree(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(SCENARIOS, "fake", FakeScenario)
    options = ("--phase", 2, "--trajectories", 20, "--lanes", 8, "--steps", 4, "--out", tmp_path / "d", "--json")
    assert call(monkeypatch, "collect", "fake", *options) == 0
    collected = json.loads(capsys.readouterr().out)
    assert call(monkeypatch, "data", "info", tmp_path / "d", "--json") == 0
    assert json.loads(capsys.readouterr().out) == collected
    assert call(monkeypatch, "data", "verify", tmp_path / "d", "--json") == 0
    verified = json.loads(capsys.readouterr().out)
    assert verified["trajectories"] == collected["trajectories"] == 20
    assert call(monkeypatch, "data", "info", tmp_path / "d") == 0
    assert "trajectories" in capsys.readouterr().out


def test_mistakes_are_one_line_and_exit_code_2(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shard = dataset / "shard-00001.parquet"
    shard.write_bytes(shard.read_bytes()[:50])
    new = ("--out", tmp_path / "new")
    cases = {
        ("colect",): "did you mean 'collect'",
        ("collect", "draging", "--phase", 1, *new): "did you mean 'dragging'",
        ("collect", "fake", "--phase", 3, *new): "phase 3",
        ("collect", "fake", "--phase", 1, "--trajectories", 0, *new): "trajectories 0",
        ("collect", "fake", "--phase", 1, "--out", dataset): "another dataset is here",
        ("collect", "fake", "--phase", 1, "--out", shard / "below"): "Not a directory",
        ("data", "info", tmp_path): "no manifest.json",
        ("scenes", "fake", "--solved-by", tmp_path, *new): "need each other",
        ("data", "verify", dataset): "shard-00001.parquet: damaged",
    }
    for arguments, expected in cases.items():
        assert call(monkeypatch, *arguments) == 2, arguments
        lines = capsys.readouterr().err.strip().splitlines()
        assert lines[-1].startswith("fairlead: ")
        assert expected in lines[-1]
        assert not any("Traceback" in line for line in lines)
    assert not (tmp_path / "new").exists()


TRAIN = ("--data", "data", "--out", "new")
EVALUATE = ("dragging", "--models", "m", "--scenes", "s", "--out", "new")
REFUSED = {
    ("train", "dynamics", "dragging", *TRAIN, "--grid", "coarse"): "--grid means nothing to train dynamics",
    ("train", "dynamics", "dragging", *TRAIN, "--trust", "t"): "--trust means nothing to train dynamics",
    (
        "train",
        "full-dynamics",
        "dragging",
        *TRAIN,
        "--network",
        "mlp",
    ): "--network means nothing to train full-dynamics",
    ("train", "dynamics", "dragging", *TRAIN, "--delta", "0.1"): "--delta means nothing to train dynamics",
    ("train", "trust", "dragging", *TRAIN, "--dynamics", "d", "--delta", "0"): "delta 0.0: a positive number",
    ("train", "trust", "dragging", *TRAIN, "--dynamics", "d", "--delta", "nan"): "delta nan: a positive number",
    ("train", "distilled", "dragging", *TRAIN): "train distilled needs --dynamics",
    ("train", "trust", "dragging", *TRAIN): "train trust needs --dynamics",
    ("train", "trust", "dragging", *TRAIN, "--dynamics", "d", "--network", "voxels"): "did you mean 'voxel'",
    ("train", "trust", "dragging", *TRAIN, "--dynamics", "d", "--grid", "paper"): "without --network voxel",
    (
        "train",
        "recovery",
        "dragging",
        *TRAIN,
        "--dynamics",
        "d",
        "--trust",
        "t",
        "--grid",
        "paper",
    ): "--grid means nothing",
    ("evaluate", *EVALUATE, "--methods", "trust", "--methods", "accept-all"): "--methods is given 2 times",
    ("evaluate", *EVALUATE, "--methods=trust", "--methods", "oracle"): "--methods is given 2 times",
    ("plan", *EVALUATE[:-2], "--scene", "a", "--scene", "b", "--trace", "new"): "--scene is given 2 times",
    (
        "plan",
        *EVALUATE[:-2],
        "--scene",
        "a",
        "--trace",
        "t",
        "--export",
        "plan.xml",
    ): "plan.xml: a trajectory is written",
    (
        "scenes",
        "dragging",
        "--scenes",
        "s",
        "--solved-by",
        "t",
        "--out",
        "new",
        "--hard",
    ): "--hard and --seed mean nothing",
    (
        "scenes",
        "dragging",
        "--scenes",
        "s",
        "--solved-by",
        "t",
        "--out",
        "new",
        "--seed",
        "0",
    ): "mean nothing with --scenes",
    ("reproduce", "real_task", "--out", "new"): "did you mean 'real_tasks'",
    ("reproduce", "real_tasks", "--sensitivity", "--out", "new"): "--sensitivity means nothing to real_tasks",
    ("report", "runs", "--no-videos", "--no_videos"): "--no-videos is given 2 times",
}


@pytest.mark.parametrize("arguments", REFUSED, ids=lambda arguments: " ".join(arguments[-4:]))
def test_nothing_that_is_given_is_silently_ignored(
    arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert call(monkeypatch, *arguments) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith("fairlead: ")
    assert REFUSED[arguments] in line
    assert list(tmp_path.iterdir()) == []


def test_an_interruption_is_one_line_and_exit_code_130(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "fairlead.cli.main", "collect", "dragging", "--phase", "1"]
    options = ["--trajectories", "1000", "--lanes", "2", "--out", str(tmp_path / "d")]
    process = subprocess.Popen(
        [*command, *options], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    )  # fmt: skip
    while process.poll() is None and not (tmp_path / "d" / "shard-00000.parquet").exists():
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate()
    assert process.returncode == 130
    assert error.strip().splitlines()[-1].startswith("fairlead: interrupted")
    assert "Traceback" not in error
    assert (tmp_path / "d" / "progress.json").exists()


def test_doctor_finds_what_the_tests_run_with(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code = call(monkeypatch, "doctor", "--json")
    found = json.loads(capsys.readouterr().out)
    assert code == (2 if any(str(value).startswith("missing") for value in found.values()) else 0)
    assert found["python"].startswith("3.")
    assert found["mujoco"][0].isdigit()


def test_scenes_of_before_are_not_replaced(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine.json"
    mine.write_text("written by hand")
    for out in (mine, tmp_path):
        assert call(monkeypatch, "scenes", "dragging", "--count", "1", "--out", out) == 2
        assert f"{out}: is there already" in capsys.readouterr().err
    assert mine.read_text() == "written by hand"


@pytest.mark.parametrize(("command", "table"), [("methods", METHODS), ("planners", PLANNERS)])
def test_a_table_names_what_evaluate_takes(
    command: str, table: dict[str, object], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(monkeypatch, command, "--json") == 0
    assert list(json.loads(capsys.readouterr().out)) == list(table)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["evaluate", "dragging", "--workers", "9999"], "timed trials"),
        (["evaluate", "dragging", "--seeds", "0"], "--seeds 0"),
        (["evaluate", "dual_arm", "--methods", "full-dynamics", "--models", "MODELS"], "here are: dynamics; "),
    ],
)
def test_what_would_mean_nothing_is_refused_before_anything_is_written(
    arguments: list[str],
    named: str,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    shutil.copytree(shipped_models("dual_arm") / "dynamics", tmp_path / "dynamics")
    arguments = [str(tmp_path) if argument == "MODELS" else argument for argument in arguments]
    assert call(monkeypatch, *arguments, "--out", tmp_path / "out") == 2
    assert named in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_who_reads_the_output_may_stop_early() -> None:
    """As `fairlead methods | head -1` does: no traceback, no message, no other exit code."""
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "fairlead.cli.main", "methods"]
    ended = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, check=False)
    os.close(writer)
    assert (ended.returncode, ended.stderr) == (0, b"")
