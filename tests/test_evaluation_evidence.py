"""Evidence: the examples are what they claim to be, and the report can draw each of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fairlead.evaluation.evidence import accepted_contacts, box_rows, labelled_trajectory, voxels, write_evidence
from fairlead.learning.labels import label
from fairlead.learning.voxels import VoxelGrid
from fairlead.planning.checks import AcceptAll, CollisionCheck
from fairlead.report.drawing import outline
from fairlead.report.evidence_figures import pictures
from fairlead.report.style import to_svg
from rope_data import LAYOUT, trajectories
from test_labels import FollowDynamics

DYNAMICS, DELTA = FollowDynamics(0.002), 0.05
DATA = trajectories(60, 12, 12, np.random.default_rng(0))


def test_labels_follow_the_distances() -> None:
    found = labelled_trajectory(DYNAMICS, DATA, DELTA, np.random.default_rng(0))
    close = found["distance"] < DELTA
    expected = np.where(close[:-1], close[1:].astype(int), -1)
    np.testing.assert_array_equal(found["labels"], expected)
    assert found["distance"][0] == pytest.approx(0, abs=1e-6)
    error = np.linalg.norm((found["predicted"] - found["actual"]).reshape(7, -1), axis=1)
    np.testing.assert_allclose(error, found["distance"], atol=1e-6)
    assert set(found["labels"]) == {1, 0, -1}


def test_contacts_touch_and_were_reliable_and_accepted() -> None:
    examples = label(DYNAMICS, DATA, DELTA)
    found = accepted_contacts(AcceptAll(), examples, DATA, 0.03)
    assert len(found["before"])
    for before, after, predicted, boxes in zip(
        found["before"], found["after"], found["predicted"], found["boxes"], strict=True
    ):
        (environment,) = [e for e in DATA.environments if np.array_equal(box_rows(e), boxes[boxes[:, 0] > 0])]
        assert environment.signed_distance(after).min() < 0.03
        assert np.linalg.norm(predicted - after) < DELTA
        assert np.linalg.norm(before - after) > 0


def test_a_check_that_accepts_no_contact_has_none_to_show() -> None:
    examples = label(DYNAMICS, DATA, DELTA)
    assert accepted_contacts(CollisionCheck(LAYOUT, 10.0), examples, DATA, 0.03) == {}


def test_voxels_have_a_channel_for_each_part() -> None:
    found = voxels(DATA, VoxelGrid((30, 30, 1), 0.02), np.random.default_rng(0))
    assert found["channels"].shape == (3, 30, 30, 1)
    assert list(found["names"]) == ["obstacles", "rope", "gripper"]
    assert found["channels"].max(axis=(1, 2, 3)) == pytest.approx(1, abs=0.5)


def test_a_folder_of_evidence_can_be_drawn(tmp_path: Path) -> None:
    grid = VoxelGrid((30, 30, 1), 0.02)
    write_evidence(DYNAMICS, AcceptAll(), DATA, DELTA, grid, 0.03, tmp_path, 0, {})
    drawn = pictures(tmp_path)
    assert len(drawn) == 3
    for canvas, caption, wide in drawn:
        assert to_svg(canvas).startswith("<?xml")
        assert caption.startswith("Fig. ")
        assert wide


def test_boxes_survive_as_rows() -> None:
    box = DATA.environments[0].boxes[0]
    row = box_rows(DATA.environments[0])[0]
    corners = outline({"size": row[:3], "position": row[3:6], "quaternion_xyzw": row[6:]})
    assert corners.mean(axis=0) == pytest.approx(box.position[:2])
