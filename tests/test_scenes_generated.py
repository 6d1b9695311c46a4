"""Laws of generated scenes, whatever the scenario."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fairlead.core.errors import FairleadError, SamplingError
from fairlead.geometry.goals import point_goal
from fairlead.scenarios.generate import generate
from fairlead.scenarios.scene_files import Scene
from fakes import LAYOUT, FakeScenario


def solved(scene: Scene) -> Scene:
    """The same with its goal where the tail is."""
    return replace(scene, goal=point_goal(LAYOUT, "tail", scene.rope[0], 0.05))


@pytest.fixture
def often_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every second draw of a seed and index is solved at the start, beginning with the first."""
    draw: Callable[..., Scene] = FakeScenario.random_scene
    drawn: dict[str, int] = {}

    def random_scene(self: FakeScenario, rng: np.random.Generator, name: str) -> Scene:
        drawn[name] = drawn.get(name, 0) + 1
        scene = draw(self, rng, name)
        return solved(scene) if drawn[name] % 2 else scene

    monkeypatch.setattr(FakeScenario, "random_scene", random_scene)


@pytest.mark.usefixtures("often_solved")
def test_no_scene_is_solved_at_the_start() -> None:
    fake = FakeScenario()
    scenes = generate(fake, "random", 6, 3)
    starts = np.stack([scene.state(fake.layout) for scene in scenes])
    reached = [scene.goal.reached(start) for scene, start in zip(scenes, starts, strict=True)]
    assert not any(reached)
    assert generate(fake, "random", 6, 3)[2:] == scenes[2:]


def test_a_generator_that_solves_every_scene_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    draw: Callable[..., Scene] = FakeScenario.random_scene
    monkeypatch.setattr(FakeScenario, "random_scene", lambda self, rng, name: solved(draw(self, rng, name)))
    with pytest.raises(SamplingError, match="its goal is reached at the start"):
        generate(FakeScenario(), "random", 1, 0)


def test_what_does_not_validate_is_drawn_again(monkeypatch: pytest.MonkeyPatch) -> None:
    refused: list[Scene] = []

    def validate(self: FakeScenario, scene: Scene) -> None:
        if len(refused) % 3 < 2:
            refused.append(scene)
            raise FairleadError("out of reach")
        refused.append(scene)

    monkeypatch.setattr(FakeScenario, "validate", validate)
    scenes = generate(FakeScenario(), "random", 3, 0)
    assert [s.name for s in scenes] == [f"random-0-{i:03d}" for i in range(3)]
    assert not any(scene in refused[:2] for scene in scenes)
    assert len(refused) == 9

    def never(self: FakeScenario, scene: Scene) -> None:
        raise FairleadError("out of reach")

    monkeypatch.setattr(FakeScenario, "validate", never)
    with pytest.raises(SamplingError, match="out of reach"):
        generate(FakeScenario(), "random", 1, 0)


def test_mistakes_have_sentences() -> None:
    with pytest.raises(FairleadError, match="count 0"):
        generate(FakeScenario(), "random", 0, 0)
    with pytest.raises(FairleadError, match="no hard scenes"):
        generate(FakeScenario(), "hard", 1, 0)
