"""Arms from a user's own file: the example, and what is wrong with a file, said in one line."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fairlead.core.errors import FairleadError, UnknownNameError
from fairlead.core.records import ActionOutcome
from fairlead.scenarios.arms import Arms

EXAMPLES = Path(__file__).parents[1] / "examples"


def test_arms_of_ones_own() -> None:
    found = subprocess.run([sys.executable, EXAMPLES / "own_arms.py"], capture_output=True, text=True, check=True)
    first, second = found.stdout.splitlines()
    assert ActionOutcome.TARGET.sentence in first
    assert ActionOutcome.ARM_COLLISION.sentence in second


def test_an_arm_stops_at_the_range_of_a_joint(tmp_path: Path) -> None:
    path = broken('name="left_1" axis="0 0 1"', 'name="left_1" axis="0 0 1" range="-20 8"', tmp_path)
    arms = Arms.from_mjcf(path, ("left_grip", "right_grip"), [2.0] * 6)
    grippers = np.array([[[0.8, 0.35, 0.8], [0.8, -0.35, 0.8]]])
    joints, reached = arms.grasp(grippers)
    left = arms.follow(joints, grippers, grippers + np.array([[0, 0.2, 0], [0, 0, 0]]), [[]])
    right = arms.follow(joints, grippers, grippers + np.array([[0, -0.2, 0], [0, 0, 0]]), [[]])
    assert reached.all()
    assert tuple(ActionOutcome)[left.outcomes[0]] is ActionOutcome.JOINT_LIMIT
    assert 0 < left.reached[0] < 6
    assert np.rad2deg(left.joints[0, : left.reached[0] + 1, 0, 0]).max() <= 8
    assert np.rad2deg(left.joints[0, left.reached[0] + 1, 0, 0]) > 8
    assert tuple(ActionOutcome)[right.outcomes[0]] is ActionOutcome.TARGET
    assert not arms.grasp(grippers + np.array([[0, 0.2, 0], [0, 0, 0]]))[1].any()


def broken(old: str, new: str, folder: Path) -> Path:
    text = (EXAMPLES / "own_arms.xml").read_text()
    assert old in text
    path = folder / "arms.xml"
    path.write_text(text.replace(old, new))
    return path


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ('name="home"', 'name="rest"', "keyframe 'home'"),
        ('name="right_6" axis="0 0 1"', 'name="right_6" type="slide" axis="0 0 1"', "'right_6'"),
        ('<joint name="left_6" axis="0 0 1"/>', "", "equal length"),
        ('<geom fromto="0 0 0.16 0 0 0.24" size="0.008"/>', '<geom name="pad" type="box" size="1 1 1"/>', "'pad'"),
        ("<worldbody>", "<world>", "arms.xml"),
    ],
)
def test_a_wrong_model_is_refused_by_name(old: str, new: str, problem: str, tmp_path: Path) -> None:
    text = broken(old, new, tmp_path)
    if "left_6" in old:
        text.write_text(text.read_text().replace("0 0.52 1.75 0.87 0 0  0", "0 0.52 1.75 0.87 0  0"))
    with pytest.raises(FairleadError, match=problem):
        Arms.from_mjcf(text, ("left_grip", "right_grip"), [1.0] * 6)


def test_an_unknown_site_and_wrong_speeds_are_refused() -> None:
    path = EXAMPLES / "own_arms.xml"
    with pytest.raises(UnknownNameError, match="did you mean 'left_grip'"):
        Arms.from_mjcf(path, ("left_gripp", "right_grip"), [1.0] * 6)
    with pytest.raises(FairleadError, match="6 positive numbers"):
        Arms.from_mjcf(path, ("left_grip", "right_grip"), [1.0] * 7)
