"""How success and first plans change from the least threshold to the greatest, written to trend.json.

Slopes of straight lines through the rates, times the range of thresholds, with 95 % intervals from scenes drawn anew.
Run here, with Fairlead installed: python trend.py
"""

from pathlib import Path

import numpy as np

from fairlead.core.artifacts import read_json, read_jsonl, write_json

HERE = Path(__file__).parent
DRAWS, SEED = 5000, 0


def trend(key: str, deltas: np.ndarray) -> dict[str, float]:
    """Of the rows' `key`, over all thresholds."""
    folders = [HERE / f"delta-{delta:g}" / "trials" / "trials.jsonl" for delta in deltas]
    rows = [sorted(read_jsonl(path), key=lambda row: row["scene"]) for path in folders]
    found = np.array([[bool(row[key]) for row in of] for of in rows], float)

    def change(of: np.ndarray) -> float:
        return float(np.polyfit(deltas, of.mean(axis=1), 1)[0] * (deltas[-1] - deltas[0]))

    rng, scenes = np.random.default_rng(SEED), found.shape[1]
    drawn = [change(found[:, rng.integers(0, scenes, scenes)]) for _ in range(DRAWS)]
    low, high = np.percentile(drawn, [2.5, 97.5])
    return {"value": round(change(found), 3), "low": round(low, 3), "high": round(high, 3)}


deltas = np.array([row["delta_m"] for row in read_json(HERE / "sensitivity.json")])
write_json(HERE / "trend.json", {key: trend(key, deltas) for key in ("success", "first_plan_success")})
