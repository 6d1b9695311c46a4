"""How good a classifier is: accuracy, precision, recall, AUROC, and whether its probabilities mean what they say."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import rankdata

BINS = 10


def auroc(probability: Float[np.ndarray, " n"], label: Bool[np.ndarray, " n"]) -> float:
    """Area under the receiver operating characteristic: P(a positive scores above a negative), ties half.

    NaN where a class is missing.
    """
    positive, negative = int(label.sum()), int((~label).sum())
    if not positive or not negative:
        return float("nan")
    ranks = rankdata(probability)[label].sum()
    return float((ranks - positive * (positive + 1) / 2) / (positive * negative))


def reliability(probability: Float[np.ndarray, " n"], label: Bool[np.ndarray, " n"]) -> list[dict[str, float]]:
    """The reliability diagram as data: in ten bins of probability, the mean of it, the share of label 1, the count."""
    bins = np.minimum((probability * BINS).astype(int), BINS - 1)
    rows = [(probability[bins == b], label[bins == b]) for b in range(BINS)]
    return [{"predicted": float(p.mean()), "observed": float(y.mean()), "count": len(p)} for p, y in rows if len(p)]


def log_loss(probability: Float[np.ndarray, " n"], target: Float[np.ndarray, " n"]) -> float:
    """Mean binary cross-entropy against labels, hard or soft."""
    p = np.clip(probability.astype(float), 1e-7, 1 - 1e-7)
    return float(-(target * np.log(p) + (1 - target) * np.log(1 - p)).mean())


def balanced_log_loss(probability: Float[np.ndarray, " n"], label: Bool[np.ndarray, " n"]) -> float:
    """Binary cross-entropy, each class weighing half."""
    present = [label == c for c in (True, False) if (label == c).any()]
    return float(np.mean([log_loss(probability[rows], label[rows].astype(float)) for rows in present]))


def classification(probability: Float[np.ndarray, " n"], label: Bool[np.ndarray, " n"]) -> dict[str, Any]:
    """Metrics of a classifier that accepts above 0.5; None where one is not defined (nothing accepted, one class)."""
    accepted = probability > 0.5
    hits = int((accepted & label).sum())
    area = auroc(probability, label)
    rates = [float((accepted == label)[label == c].mean()) for c in (True, False) if (label == c).any()]
    return {
        "accuracy": float((accepted == label).mean()),
        "balanced_accuracy": float(np.mean(rates)),
        "precision": hits / int(accepted.sum()) if accepted.any() else None,
        "recall": hits / int(label.sum()) if label.any() else None,
        "auroc": None if np.isnan(area) else area,
        "log_loss": log_loss(probability, label.astype(float)),
        "reliable_share": float(label.mean()),
        "accepted_share": float(accepted.mean()),
        "examples": len(label),
        "reliability": reliability(probability, label),
    }


def best_threshold(spread: Float[np.ndarray, " example"], reliable: Bool[np.ndarray, " example"]) -> float:
    """The spread [m] below which to trust a prediction: the best balanced accuracy on labelled validation examples.

    Every midpoint between two neighbouring values is tried, and both ends, so that trusting all or nothing may win. Of
    equally good ones the one that trusts most is taken.
    """
    values = np.unique(spread)
    cuts = np.concatenate([[values[0] / 2], (values[1:] + values[:-1]) / 2, [values[-1] * 2 + 1e-12]])
    kept = np.searchsorted(np.sort(spread[reliable]), cuts) / max(1, int(reliable.sum()))
    passed = np.searchsorted(np.sort(spread[~reliable]), cuts) / max(1, int((~reliable).sum()))
    gain = kept - passed
    return float(cuts[np.flatnonzero(gain == gain.max())[-1]])
