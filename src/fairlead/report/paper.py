"""The paper's own results, to stand beside ours: Tables 1 and 2, and the numbers of its text."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PaperRow:
    """One method of the paper: success rate, and min, max, mean, median and SD of the final error [m]."""

    name: str
    success: float
    error_m: tuple[float | None, float | None, float, float | None, float | None]


RESULTS: dict[str, tuple[PaperRow, ...]] = {
    "dragging": (
        PaperRow("classifier", 0.76, (0.009, 1.133, 0.128, 0.044, 0.247)),
        PaperRow("no classifier", 0.60, (0.014, 1.408, 0.325, 0.045, 0.425)),
        PaperRow("full dynamics", 0.32, (0.004, 1.519, 0.438, 0.156, 0.450)),
        PaperRow("collision checker", 0.78, (None, None, 0.127, None, None)),
    ),
    "dual_arm": (
        PaperRow("classifier, learned recovery", 0.84, (0.014, 0.450, 0.073, 0.045, 0.094)),
        PaperRow("classifier, random recovery", 0.78, (0.016, 0.629, 0.081, 0.046, 0.106)),
        PaperRow("classifier", 0.61, (0.015, 0.630, 0.147, 0.047, 0.167)),
        PaperRow("no classifier", 0.47, (0.011, 0.741, 0.170, 0.082, 0.165)),
        PaperRow("full dynamics", 0.177, (0.019, 0.621, 0.203, 0.191, 0.142)),
    ),
}

LEARNING: dict[str, dict[tuple[str, str], float]] = {
    "dragging": {
        ("dynamics", "test_point_error_m"): 0.0097,
        ("dynamics", "delta_m"): 0.065,
        ("trust", "accuracy"): 0.835,
        ("trust", "precision"): 0.888,
        ("trust", "recall"): 0.789,
        ("recovery", "log_loss"): 0.023,
        ("full-dynamics", "test_point_error_m"): 0.0117,
    },
    "dual_arm": {
        ("dynamics", "test_point_error_m"): 0.0030,
        ("dynamics", "delta_m"): 0.025,
        ("trust", "accuracy"): 0.890,
        ("trust", "precision"): 0.895,
        ("trust", "recall"): 0.927,
        ("recovery", "log_loss"): 0.146,
        ("full-dynamics", "test_point_error_m"): 0.0218,
    },
}
"""Scenario -> (kind of model, metric) -> what the paper reports of it on test data ("Learning performance")."""
