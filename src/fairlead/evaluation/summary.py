"""What a set of trials says: one entry a method, and paired comparisons of one, the reference, with the rest.

Trials of one scene with several seeds resemble each other. For intervals and tests a scene counts once, with the mean
of its seeds: the careful side, since it treats them as if they were all the same.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from fairlead.core.budget import Budget
from fairlead.core.streams import stream
from fairlead.evaluation.statistics import (
    error_statistics,
    mcnemar_p,
    paired_bootstrap,
    success_against,
    welch_p,
    wilson,
)

Row = Mapping[str, Any]
TIMES_S = (15.0, 30.0, 60.0, 180.0)
"""Success is reported after those of these seconds that the budget allows: 180 s, the paper's, hides differences. A
counted budget knows no time."""


def _mean(rows: Sequence[Row], key: str) -> float:
    return float(np.mean([row[key] for row in rows]))


def _total(rows: Sequence[Row], key: str) -> int:
    return sum(int(row[key]) for row in rows)


def _scenes(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """The trials of each scene."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(row["scene"], []).append(row)
    return found


def _by_scene(rows: Sequence[Row], key: str) -> dict[str, float]:
    """The mean of a column over the seeds of each scene.

    Where there was no first plan, because a trial ended before one was executed, it is counted as one that failed.
    """
    return {scene: float(np.mean([float(row[key] or 0) for row in of])) for scene, of in _scenes(rows).items()}


def _rate(rows: Sequence[Row], key: str) -> dict[str, float]:
    """The share of trials in which something is so, with Wilson's interval for as many trials as there are scenes."""
    rates = list(_by_scene(rows, key).values())
    return asdict(wilson(min(sum(rates), len(rates)), len(rates)))


def _method_summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Everything reported about one method; rates with Wilson intervals, errors in metres, times in seconds.

    Errors, outcomes and effort are of trials, not of scenes.
    """
    seconds = Budget.parse(rows[0]["budget"]).seconds
    times = [time for time in TIMES_S if time <= seconds < math.inf]
    by_scene = [[row["reached_at_s"] for row in of] for of in _scenes(rows).values()]
    reached = np.mean([success_against(of, np.array(times)) for of in by_scene], axis=0)
    return {
        "trials": len(rows),
        "budget": rows[0]["budget"],
        "success": _rate(rows, "success"),
        "first_plan_success": _rate(rows, "first_plan_success"),
        "success_at_s": {f"{time:g}": float(rate) for time, rate in zip(times, reached, strict=True)},
        "error_m": error_statistics(np.array([row["error_m"] for row in rows])),
        "outcomes": dict(Counter(row["outcome"] for row in rows)),
        "action_outcomes": dict(sum((Counter(row.get("action_outcomes", {})) for row in rows), Counter[str]())),
        "stuck_trials": sum(row["times_stuck"] > 0 for row in rows),
        **{key: _total(rows, key) for key in ("times_stuck", "recovery_actions")},
        **{f"mean_{key}": _mean(rows, key) for key in ("planning_s", "execution_s", "extensions", "plans", "actions")},
    }


def _comparison(ours: Sequence[Row], baseline: Sequence[Row], rng: np.random.Generator) -> dict[str, Any]:
    """Ours against a baseline, on the trials that both have: the paper's t-test, and paired tests.

    Differences with intervals need two scenes at least.
    """
    theirs = {(row["scene"], row["seed"]): row for row in baseline}
    pairs = [(row, theirs[row["scene"], row["seed"]]) for row in ours if (row["scene"], row["seed"]) in theirs]
    result: dict[str, Any] = {"pairs": len(pairs), "welch_p": None}
    if not pairs:
        return result

    def means(key: str) -> tuple[np.ndarray, np.ndarray]:
        """Ours and theirs, in the same order of scenes."""
        mine, other = (np.array(list(_by_scene([pair[side] for pair in pairs], key).values())) for side in (0, 1))
        return mine, other

    errors, success, first = means("error_m"), means("success"), means("first_plan_success")
    result["welch_p"] = welch_p(*errors)
    for name, (mine, other) in (("mcnemar_p", success), ("first_plan_mcnemar_p", first)):
        result[name] = mcnemar_p(mine > other, mine < other)
    if len(errors[0]) == 1:
        # Resampling a single scene always gives that scene: an interval of no width, which would be a lie.
        return result
    return result | {
        "success_difference": asdict(paired_bootstrap(success[0] - success[1], rng)),
        "error_difference_m": asdict(paired_bootstrap(errors[0] - errors[1], rng)),
    }


def summarise(rows: Sequence[Row], methods: Sequence[str], seed: int, stated: str | None = None) -> dict[str, Any]:
    """Summarise trial rows.

    Args:
        rows: trials, in any order.
        methods: names in the order to report.
        seed: of the bootstrap.
        stated: the reference, which is compared with each of the other methods. Where it is None or has no trials, the
            first of `methods` that has some.

    Returns: "order", the methods that have trials; "reference", and "reference_because", why it is the one; "methods",
        name to numbers; and "comparisons", a list of {"method" (the reference), "baseline", ...}.
    """
    ordered = sorted(rows, key=lambda row: (row["scene"], row["seed"]))
    of = {method: [row for row in ordered if row["method"] == method] for method in methods}
    present = [method for method in methods if of[method]]
    reference = stated if stated in present else present[0]
    because = "it was asked for" if stated in present else "it is the first in the table of methods of those tried"
    return {
        "order": present,
        "reference": reference,
        "reference_because": because,
        "methods": {method: _method_summary(of[method]) for method in present},
        "comparisons": [
            {"method": reference, "baseline": name}
            | _comparison(of[reference], of[name], stream(seed, "bootstrap", name))
            for name in present
            if name != reference
        ],
    }
