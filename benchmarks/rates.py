"""A ratio of two rates that were measured in turns, so that both saw the same machine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median


@dataclass(frozen=True)
class Rates:
    """Median of the ratios of the pairs, and the median of each rate."""

    ratio: float
    ours: float
    reference: float

    @classmethod
    def of(cls, pairs: Sequence[tuple[float, float]]) -> Rates:
        """From pairs (ours, reference), each measured in one turn."""
        return cls(median(a / b for a, b in pairs), median(a for a, _ in pairs), median(b for _, b in pairs))
