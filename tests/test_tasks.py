"""Laws of the tasks: their scenes are sound, and starts and goals are what they are said to be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fairlead.data.collect import CollectConfig, collect
from fairlead.data.verify import verify
from fairlead.evaluation.shipped import benchmark_scenes
from fairlead.reproduce.presets import preset
from fairlead.scenarios.generate import generate
from fairlead.scenarios.registry import TASKS, scenario
from fairlead.scenarios.rope import RopeFactors
from fairlead.scenarios.task import MOVED, Task

NAMES = [spec.name for spec in TASKS]
each_task = pytest.mark.parametrize("name", NAMES)


@each_task
def test_twenty_variations_come_with_the_package(name: str) -> None:
    task = scenario(name)
    scenes = task.scenes(benchmark_scenes(name)).scenes
    assert len(scenes) == 20
    assert len({scene.obstacles for scene in scenes}) == len({scene.rope for scene in scenes}) == 20
    starts = np.stack([scene.state(task.layout) for scene in scenes])
    assert not any(scene.goal.reached(start) for scene, start in zip(scenes, starts, strict=True))
    some = slice(0, 20, 7)
    assert (task.simulate([scene.obstacles for scene in scenes[some]], starts[some]).residual < 2 * MOVED).all()


@pytest.mark.parametrize("name", ["fetch_cable", "remove_straps"])
def test_variations_depend_on_their_seed_alone(name: str) -> None:
    first, again, other = (generate(scenario(name), "random", 1, seed) for seed in (3, 3, 4))
    assert first == again != other


@each_task
def test_a_task_takes_what_its_base_has_learned(name: str) -> None:
    task = scenario(name)
    base = scenario(task.base or "")
    assert task.kin == (name, base.name)
    assert base.kin == (base.name,)
    assert (task.layout, task.rope_radius, task.link_length) == (base.layout, base.rope_radius, base.link_length)
    assert preset(task, "smoke") == preset(base, "smoke")


def test_the_cable_ends_behind_the_printer_and_the_phone_lies_before_it() -> None:
    task = scenario("fetch_cable")
    for scene in task.scenes(benchmark_scenes("fetch_cable")).scenes:
        printer = scene.obstacles[0].boxes[0]
        tail, place = scene.rope[0], scene.goal.written()["position"]
        behind, before = ((np.array(point) - printer.position) @ printer.rotation[:, 1] for point in (tail, place))
        assert behind > printer.size[1] / 2
        assert before < -printer.size[1] / 2


def test_looped_straps_hold_against_a_pull_upwards_and_come_off_forwards() -> None:
    task = scenario("remove_straps")
    assert isinstance(task, Task)
    scenes = task.scenes(benchmark_scenes("remove_straps")).scenes[1:4]
    starts = np.stack([scene.state(task.layout) for scene in scenes])

    def ends_outside(*legs: tuple[float, float, float]) -> np.ndarray:
        world = task.simulate([scene.obstacles for scene in scenes], starts)
        for leg in legs:
            world.execute(world.observe()[:, : task.layout.action_size] + np.tile(leg, 2))
        return np.array([scene.goal.reached(state) for scene, state in zip(scenes, world.observe(), strict=True)])

    assert not ends_outside((0.0, 0.0, 0.1), (0.0, 0.0, 0.1)).any()
    assert ends_outside((0.0, 0.0, -0.05), (-0.1, 0.0, 0.0), (-0.1, 0.0, 0.0)).all()


@pytest.mark.parametrize("name", ["fetch_cable", "remove_straps"])
def test_data_of_phase_2_come_from_scenes_like_the_task_s(name: str, tmp_path: Path) -> None:
    task = scenario(name)
    collect(task, CollectConfig(2, 4, lanes=4, steps=2), tmp_path)
    assert verify(tmp_path)


def test_a_task_can_be_carried_out_with_another_rope() -> None:
    heavy = scenario("fetch_cable").altered(RopeFactors(mass=2.0))
    assert heavy.name == "fetch_cable"
    assert heavy.base == "dragging"
