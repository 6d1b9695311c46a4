"""Laws of the summary: it does not depend on the order of the rows, and its numbers agree with counting by hand."""

from __future__ import annotations

import json

import numpy as np
import pytest

import synthetic
from fairlead.evaluation.summary import summarise

METHODS = tuple(synthetic.RATES)


def test_the_order_of_rows_does_not_matter() -> None:
    rows = synthetic.rows()
    shuffled = [rows[i] for i in np.random.default_rng(1).permutation(len(rows))]
    assert summarise(rows, METHODS, 0) == summarise(shuffled, METHODS, 0)


def test_it_is_json_and_keeps_the_order_of_methods() -> None:
    rows = synthetic.rows(scenes=1, seeds=1)
    summary = summarise(rows, ("accept-all", "oracle", "trust"), 0)
    assert summary["order"] == ["accept-all", "trust"]
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary


def test_counts_agree_with_the_rows() -> None:
    rows = synthetic.rows()
    for name, found in summarise(rows, METHODS, 0)["methods"].items():
        own = [row for row in rows if row["method"] == name]
        assert found["trials"] == len(own) == sum(found["outcomes"].values())
        assert found["success"]["value"] == np.mean([row["success"] for row in own])
        assert list(found["success_at_s"]) == ["15", "30", "60"]  # the budget is 60 s
        at = list(found["success_at_s"].values())
        assert at == sorted(at)
        assert at[-1] == found["success"]["value"]


@pytest.mark.parametrize(("budget", "times"), [("seconds=20", 1), ("seconds=180", 4), ("extensions=9", 4)])
def test_success_is_told_at_no_time_beyond_the_budget(budget: str, times: int) -> None:
    rows = [{**row, "budget": budget} for row in synthetic.rows(scenes=2)]
    assert all(len(found["success_at_s"]) == times for found in summarise(rows, METHODS, 0)["methods"].values())


def test_the_reference_is_the_one_stated_else_the_first_that_was_tried() -> None:
    rows = synthetic.rows(scenes=2, methods=("accept-all", "trust"))
    for stated, expected in ((None, "trust"), ("accept-all", "accept-all"), ("trust-sdf", "trust")):
        found = summarise(rows, ("trust-sdf", "trust", "accept-all"), 0, stated)
        assert found["reference"] == expected
        assert [item["method"] for item in found["comparisons"]] == [expected]
        assert (found["reference_because"] == "it was asked for") == (stated == expected)


def test_a_method_beside_itself_differs_by_nothing() -> None:
    rows = synthetic.rows(methods=("trust",))
    twin = [{**row, "method": "twin"} for row in rows]
    (found,) = summarise([*rows, *twin], ("trust", "twin"), 0)["comparisons"]
    assert found["pairs"] == len(rows)
    assert found["success_difference"] == {"value": 0, "low": 0, "high": 0}
    assert found["mcnemar_p"] == 1
    assert found["welch_p"] == pytest.approx(0.5)


def test_only_common_scenes_are_paired() -> None:
    rows = [row for row in synthetic.rows() if row["method"] == "trust" or row["scene"] < "scene-005"]
    found = summarise(rows, ("trust", "accept-all"), 0)["comparisons"][0]
    assert found["pairs"] == 10


def test_one_scene_has_no_interval() -> None:
    found = summarise(synthetic.rows(scenes=1, seeds=3), ("trust", "accept-all"), 0)["comparisons"][0]
    assert found["pairs"] == 3
    assert "success_difference" not in found
