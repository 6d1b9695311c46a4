"""What makes a dual-arm start hard."""

from __future__ import annotations

import numpy as np
import pytest

from fairlead.core.streams import stream
from fairlead.scenarios.dual_arm import LAYOUT, OBSTACLES, DualArm
from fairlead.scenarios.dual_arm_hard import astray, caught, draped, hard_scene

DUAL_ARM = DualArm()
HOOK = OBSTACLES[5].moved((0.8, 0.0, 0.0), 0.0)
POSTS = tuple(OBSTACLES[i].moved((0.8, y, 0.0), 0.0) for i, y in ((0, -0.15), (1, 0.15)))


def _along_y(x: float, z: np.ndarray | float) -> np.ndarray:
    y = np.linspace(-0.36, 0.36, LAYOUT.points)
    return np.stack([np.full_like(y, x), y, np.broadcast_to(z, y.shape)], axis=-1)


def test_a_rope_under_a_plate_is_caught_and_one_above_or_beside_it_is_not() -> None:
    beside_the_post = 0.8 - 0.08
    assert caught(DUAL_ARM, [HOOK], _along_y(beside_the_post, 0.70))
    assert not caught(DUAL_ARM, [HOOK], _along_y(beside_the_post, 0.85))
    assert not caught(DUAL_ARM, [HOOK], _along_y(0.5, 0.70))
    assert not caught(DUAL_ARM, POSTS, _along_y(beside_the_post, 0.70))


def test_a_draped_rope_rests_in_two_places() -> None:
    y = np.linspace(-0.36, 0.36, LAYOUT.points)
    top = np.array([box.position[2] + box.size[2] / 2 for post in POSTS for box in post.boxes])
    resting = np.where(np.abs(y + 0.15) < 0.03, top[0], np.where(np.abs(y - 0.15) < 0.03, top[1], 0.95)) + 0.011
    assert draped(DUAL_ARM, POSTS, _along_y(0.8, resting))
    assert not draped(DUAL_ARM, POSTS[:1], _along_y(0.8, resting))
    assert astray(DUAL_ARM, POSTS[:1], _along_y(0.8, resting))
    assert not astray(DUAL_ARM, POSTS, _along_y(0.8, 1.1))


def test_a_hard_scene_is_of_its_kind_and_comes_from_its_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fairlead.scenarios.dual_arm_hard.ACTIONS", 2)
    monkeypatch.setattr("fairlead.scenarios.dual_arm_hard.TOGETHER", 4)
    scene = hard_scene(DUAL_ARM, "astray", stream(3, "hard"), "one")
    DUAL_ARM.validate(scene)
    assert astray(DUAL_ARM, scene.obstacles, LAYOUT.points_of(scene.state(LAYOUT)))
    assert scene == hard_scene(DUAL_ARM, "astray", stream(3, "hard"), "one")
