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
        assert found["success"]["value"] == pytest.approx(np.mean([row["success"] for row in own]))
        assert list(found["success_at_s"]) == ["15", "30", "60"]  # the budget is 60 s
        at = list(found["success_at_s"].values())
        assert at == sorted(at)
        assert at[-1] == pytest.approx(found["success"]["value"])


@pytest.mark.parametrize(("budget", "times"), [("seconds=20", 1), ("seconds=180", 4), ("extensions=9", 0)])
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


def test_a_seed_that_repeats_another_makes_nothing_surer() -> None:
    """Trials of one scene resemble each other: intervals and P values are those of its scenes, not of its trials."""
    once = synthetic.rows(seeds=1)
    again = [{**row, "seed": seed} for row in once for seed in (0, 1, 2)]
    alone, repeated = (summarise(rows, METHODS, 0) for rows in (once, again))
    for name in alone["order"]:
        for key in ("success", "first_plan_success"):
            assert repeated["methods"][name][key] == pytest.approx(alone["methods"][name][key])
    for one, three in zip(alone["comparisons"], repeated["comparisons"], strict=True):
        for key in ("mcnemar_p", "first_plan_mcnemar_p", "welch_p"):
            assert three[key] == pytest.approx(one[key])
        for key in ("success_difference", "error_difference_m"):
            assert three[key] == pytest.approx(one[key])
    assert min(item["mcnemar_p"] for item in alone["comparisons"]) < 1


def test_a_scene_counts_once_however_many_seeds_it_has() -> None:
    rows = [row for row in synthetic.rows(seeds=3) if row["seed"] == 0 or row["scene"] == "scene-000"]
    for name, found in summarise(rows, METHODS, 0)["methods"].items():
        own = [row for row in rows if row["method"] == name]
        scenes = {row["scene"] for row in own}
        rates = [np.mean([row["success"] for row in own if row["scene"] == scene]) for scene in scenes]
        assert found["success"]["value"] == pytest.approx(np.mean(rates))
        assert found["success_at_s"]["60"] == pytest.approx(found["success"]["value"])


def test_only_common_scenes_are_compared() -> None:
    rows = [row for row in synthetic.rows() if row["method"] == "trust" or row["scene"] < "scene-005"]
    common = [row for row in rows if row["scene"] < "scene-005"]
    found, alike = (summarise(some, ("trust", "accept-all"), 0)["comparisons"][0] for some in (rows, common))
    assert found["pairs"] == 10
    assert found == alike


def test_one_scene_has_no_interval() -> None:
    found = summarise(synthetic.rows(scenes=1, seeds=3), ("trust", "accept-all"), 0)["comparisons"][0]
    assert found["pairs"] == 3
    assert "success_difference" not in found
