"""The statistics of a comparison: intervals, the numbers of Table 1, the paper's t-test, and paired tests beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy import stats


@dataclass(frozen=True)
class Interval:
    """An estimate and its 95 % interval."""

    value: float
    low: float
    high: float


def wilson(successes: float, trials: int, confidence: float = 0.95) -> Interval:
    """A proportion with Wilson's score interval, which stays inside [0, 1] and is sound near its ends.

    Successes need not be whole: where several seeds share a scene, a scene is one trial that succeeded in part.

    Raises:
        ValueError: without a trial there is no proportion.
    """
    if not 0 <= successes <= trials or trials == 0:
        raise ValueError(f"{successes} successes of {trials} trials is not a proportion")
    z = float(stats.norm.ppf(0.5 + confidence / 2))
    p = successes / trials
    centre = (p + z**2 / (2 * trials)) / (1 + z**2 / trials)
    half = z / (1 + z**2 / trials) * np.sqrt(p * (1 - p) / trials + z**2 / (4 * trials**2))
    return Interval(p, max(0.0, min(p, float(centre - half))), min(1.0, max(p, float(centre + half))))


def error_statistics(errors: Float[np.ndarray, " trial"]) -> dict[str, float]:
    """The columns of the paper's Table 1 [m]: least, greatest, mean and median error, standard deviation (n - 1)."""
    spread = float(np.std(errors, ddof=1)) if len(errors) > 1 else 0.0
    return {
        "min": float(np.min(errors)),
        "max": float(np.max(errors)),
        "mean": float(np.mean(errors)),
        "median": float(np.median(errors)),
        "sd": spread,
    }


def success_against(values: Sequence[float | None], limits: Float[np.ndarray, " limit"]) -> Float[np.ndarray, " limit"]:
    """Share of trials whose value is at most each limit; None (never reached) is above every limit.

    With final errors [m] this is the curve of Fig. 6, with the times of reaching the goal [s] success against time.
    """
    known = np.array([np.inf if value is None else value for value in values])
    return (known[None, :] <= np.asarray(limits)[:, None]).mean(axis=1)


def welch_p(errors: Float[np.ndarray, " ours"], baseline: Float[np.ndarray, " theirs"]) -> float | None:
    """P value of the one-sided t-test on final errors, H1: ours is smaller on average; None where it is undefined.

    The paper says "a one-sided t test"; unpaired and without equal variances (Welch) is assumed here.
    """
    if len(errors) < 2 or len(baseline) < 2 or np.ptp(errors) + np.ptp(baseline) == 0:
        return None
    return float(stats.ttest_ind(errors, baseline, equal_var=False, alternative="less").pvalue)


def paired_bootstrap(
    differences: Float[np.ndarray, " scene"], rng: np.random.Generator, resamples: int = 10_000
) -> Interval:
    """Mean of paired differences, one a scene, with a percentile interval; of no width where all are alike."""
    drawn = rng.integers(len(differences), size=(resamples, len(differences)))
    low, high = np.quantile(differences[drawn].mean(axis=1), [0.025, 0.975])
    return Interval(float(np.mean(differences)), float(low), float(high))


def mcnemar_p(ours: Bool[np.ndarray, " pair"], baseline: Bool[np.ndarray, " pair"]) -> float:
    """Exact one-sided P value that ours succeeds more often on the same trials (McNemar: only unequal pairs count)."""
    won = int(np.sum(ours & ~baseline))
    lost = int(np.sum(~ours & baseline))
    return float(stats.binomtest(won, won + lost, alternative="greater").pvalue) if won + lost else 1.0
