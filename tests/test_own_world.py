"""A world that is no rope and needs no simulator: the example learns where to trust, and it pays."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fairlead.core.artifacts import read_jsonl
from fairlead.core.contracts import check_world
from fairlead.core.streams import stream
from fairlead.data.verify import verify
from fairlead.learning.registry import load_check
from fairlead.reproduce.presets import PRESETS, preset
from fairlead.scenarios.registry import SCENARIOS

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture(scope="module")
def own() -> Any:
    sys.path.insert(0, str(EXAMPLES))
    import own_world

    yield own_world
    sys.path.remove(str(EXAMPLES))


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("ground")


@pytest.fixture(scope="module")
def arrived(own: Any, models: Path) -> dict[str, list[bool]]:
    return own.main(models, trajectories=128, trials=5)


@pytest.mark.usefixtures("arrived")
def test_the_world_keeps_the_contract_and_its_data_are_sound(
    own: Any, models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ground, rng = own.Ground(), stream(0, "ground")
    starts = np.stack([ground.random_start(rng) for _ in range(5)])
    world = ground.simulate([ground.random_ice(rng) for _ in starts], starts)
    check_world(world, ground.sampler.propose(starts, rng))
    monkeypatch.setitem(SCENARIOS, "ground", own.Ground)
    assert verify(models / "icy")["trajectories"] == 128


def test_installed_it_takes_the_whole_line_with_sizes_of_its_kind(own: Any, tmp_path: Path) -> None:
    about = tmp_path / "ground-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: ground\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[fairlead.scenarios]\nground = own_world:Ground\n")
    path = os.pathsep.join([*map(str, (tmp_path, EXAMPLES)), os.environ.get("PYTHONPATH", "")])
    line = [sys.executable, "-m", "fairlead.cli.main", "reproduce", "ground", "--preset", "smoke", "--threads", "1"]
    subprocess.run([*line, "--out", tmp_path / "out"], env=os.environ | {"PYTHONPATH": path}, check=True)
    smoke = preset(own.Ground(), "smoke")
    assert smoke == PRESETS["dragging"]["smoke"]
    scenes = own.Ground().scenes(tmp_path / "out" / "scenes.json").scenes
    assert len(scenes) == 50
    rows = list(read_jsonl(tmp_path / "out" / "trials" / "benchmark" / "trials.jsonl"))
    assert {row["method"] for row in rows} == set(smoke.methods)
    assert {row["scene"] for row in rows} == {scenes[0].name}
    assert "ground" in (tmp_path / "out" / "report" / "report.html").read_text()


def test_ice_holds_the_robot_and_dry_ground_does_not(own: Any) -> None:
    ground = own.Ground()
    ice = (own.Obstacle("ice", (own.Box((0.4, 0.4, 1.0), (0.0, 0.0, 0.0)),)),)
    world = ground.simulate([ice, ice], np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]]))
    moved = world.execute(world.observe() + np.array([0.1, 0.0, 0.0])).states - [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]]
    np.testing.assert_allclose(moved[:, 0], [0.01 * 0.1 / 1.2, 0.1 / 1.2])


@pytest.mark.usefixtures("arrived")
def test_trust_is_low_on_ice_and_high_where_it_is_dry(own: Any, models: Path) -> None:
    ground = own.Ground()
    check = load_check(models / "trust", "ground")
    for i in range(4):
        scene = ground.random_scene(stream(2, i), "any")
        places = np.append(stream(3, i).uniform(-0.9, 0.9, (400, 2)), np.zeros((400, 1)), axis=1)
        depth = ground.environment(scene.obstacles).signed_distance(places)
        trust = own.trust_at(own.problem(ground, scene, models, check), places)
        assert trust[depth < -0.03].mean() < 0.2
        assert trust[depth > 0.15].mean() > 0.8


def test_a_robot_that_knows_where_to_trust_arrives_more_often(arrived: dict[str, list[bool]], models: Path) -> None:
    assert sum(arrived["trust"]) >= 4
    assert sum(arrived["accept all"]) <= sum(arrived["trust"]) - 2
    assert (models / "trust.png").stat().st_size > 10_000
