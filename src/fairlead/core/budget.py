"""What a trial may spend: seconds (planning wall time plus simulated execution) or a count of extensions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from fairlead.core.errors import FairleadError

Clock = Callable[[], float]


@dataclass(frozen=True)
class Budget:
    """Exactly one of `seconds` and `extensions` is set; the other is infinite.

    A budget of extensions (checked transitions) makes a trial bit-identical on one machine.
    """

    seconds: float = math.inf
    extensions: float = math.inf

    def __post_init__(self) -> None:
        finite = [value for value in (self.seconds, self.extensions) if math.isfinite(value)]
        if len(finite) != 1 or not finite[0] > 0:
            raise FairleadError("a budget is one positive number of seconds or of extensions")

    @classmethod
    def parse(cls, text: str) -> Budget:
        """Read `seconds=180` or `extensions=20000`."""
        unit, _, number = text.partition("=")
        try:
            value = float(number)
        except ValueError:
            value = math.nan
        if unit not in ("seconds", "extensions") or not (value > 0 and math.isfinite(value)):
            raise FairleadError(f"budget '{text}': write seconds=N or extensions=N with a positive number N")
        return cls(**{unit: value})

    def __str__(self) -> str:
        if math.isfinite(self.seconds):
            return f"seconds={self.seconds:.15g}"
        return f"extensions={self.extensions:.15g}"


@dataclass
class Meter:
    """Spends a budget. Planning seconds come from `clock`; execution seconds are simulated and charged."""

    budget: Budget
    clock: Clock
    planning_s: float = 0.0
    execution_s: float = 0.0
    extensions: int = 0
    _started: float | None = field(default=None, repr=False)

    def start_planning(self) -> None:
        """Planning wall time runs from here to `stop_planning`."""
        self._started = self.clock()

    def stop_planning(self) -> None:
        """Add the wall time since `start_planning`."""
        if self._started is not None:
            self.planning_s += self.clock() - self._started
            self._started = None

    def charge_execution(self, seconds: float) -> None:
        """Add simulated seconds of execution."""
        self.execution_s += seconds

    def charge_extensions(self, count: int) -> None:
        """Add checked transitions."""
        self.extensions += count

    @property
    def spent_s(self) -> float:
        """Planning wall time plus simulated execution time [s]."""
        running = 0.0 if self._started is None else self.clock() - self._started
        return self.planning_s + running + self.execution_s

    @property
    def exhausted(self) -> bool:
        """Whether nothing is left."""
        return self.spent_s >= self.budget.seconds or self.extensions >= self.budget.extensions
