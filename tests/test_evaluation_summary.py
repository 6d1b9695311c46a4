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
        at = [found["success_at_s"][key] for key in ("15", "30", "60", "180")]
        assert at == sorted(at)
        assert at[-1] == found["success"]["value"]


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
