"""What a planner is given, what it must return, and when a transition is accepted: the same for every planner."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from jaxtyping import Bool, Float

from fairlead.core.answers import expect
from fairlead.core.budget import Meter
from fairlead.core.errors import FairleadError
from fairlead.core.layout import StateLayout
from fairlead.core.records import Plan, Transitions
from fairlead.core.roles import LEAST_TRUST, ActionSampler, Dynamics, Environment, Goal, TransitionCheck


@dataclass(frozen=True)
class Tried:
    """Predicted transitions after the check: where they lead, the trust in each, and which are accepted."""

    next_states: Float[np.ndarray, "batch state"]
    encodings: Float[np.ndarray, "batch feature"]
    trust: Float[np.ndarray, " batch"]
    accepted: Bool[np.ndarray, " batch"]
    invalid: int


@dataclass(frozen=True)
class Problem:
    """Where, whereto, with which model, whom to trust, and from which probability on."""

    environment: Environment
    goal: Goal
    dynamics: Dynamics
    check: TransitionCheck
    sampler: ActionSampler
    threshold: float = 0.5

    def __post_init__(self) -> None:
        if not LEAST_TRUST <= self.threshold < 1:
            raise FairleadError(f"threshold {self.threshold}: a probability of at least {LEAST_TRUST} is needed")

    @property
    def layout(self) -> StateLayout:
        """How to read a state."""
        return self.dynamics.layout

    def attempt(
        self,
        states: Float[np.ndarray, "batch state"],
        actions: Float[np.ndarray, "batch action"],
        encodings: Float[np.ndarray, "batch feature"],
    ) -> Tried:
        """Predict and check transitions: one call of the dynamics, one `encode` and one `probability`.

        Accepted: predicted within bounds, with a probability above the threshold. What is not finite is rejected, and
        counted.
        """
        prediction = self.dynamics.predict(self.environment, states, actions)
        mean, spread = prediction.mean, prediction.spread
        expect(self.dynamics, "the predicted mean", mean, states.shape)
        expect(self.dynamics, "the predicted spread", spread, (len(states),))
        finite = np.isfinite(mean).all(axis=1) & np.isfinite(spread)
        if not finite.all():
            mean = np.where(finite[:, None], mean, states)
        next_encodings = self.check.encode(self.environment, mean)
        transitions = Transitions(states, actions, mean, spread)
        trust = self.check.probability(self.environment, transitions, encodings, next_encodings)
        expect(self.check, "the probability", trust, (len(states),))
        if np.any(trust > 1):
            raise FairleadError(f"{type(self.check).__name__}: a probability of {np.nanmax(trust):.4g}, above 1")
        accepted = finite & self.environment.contains(mean) & (trust > self.threshold)
        return Tried(mean, next_encodings, trust, accepted, int((~finite | np.isnan(trust)).sum()))


@dataclass(frozen=True)
class SearchSettings:
    """What all planners share (paper, "Planning"; its authors' numbers, but for the limits of an attempt).

    Args:
        goal_bias: how often the tree is steered to the goal instead of a random state.
        repeats: a sampled control is repeated for 1 to this many steps.
        stuck_attempts: so many rejected extensions of the start, and none accepted, mean stuck.
        attempt_seconds: longest planning attempt [s] (docs/adr/0006); has no effect under a counted budget.
        attempt_extensions: most transitions checked in one attempt.
    """

    goal_bias: float = 0.05
    repeats: int = 10
    stuck_attempts: int = 32
    attempt_seconds: float = 10.0
    attempt_extensions: int = 20_000

    def __post_init__(self) -> None:
        if not 0 <= self.goal_bias <= 1:
            raise FairleadError(f"goal_bias {self.goal_bias}: a probability is needed")
        if min(self.repeats, self.stuck_attempts, self.attempt_extensions, self.attempt_seconds) <= 0:
            raise FairleadError("repeats, stuck_attempts, attempt_seconds and attempt_extensions must be positive")

    def scaled(self, factor: float) -> SearchSettings:
        """The same with attempts so many times as long."""
        return replace(
            self,
            attempt_seconds=factor * self.attempt_seconds,
            attempt_extensions=int(factor * self.attempt_extensions),
        )


PAPER = SearchSettings()


@final
class Allowance:
    """What one planning attempt may still spend: its own limits, within what the meter has left."""

    def __init__(self, settings: SearchSettings, meter: Meter) -> None:
        self._meter = meter
        counted = math.isfinite(meter.budget.extensions)
        left = meter.budget.extensions - meter.extensions if counted else math.inf
        self._last = meter.extensions + int(min(settings.attempt_extensions, max(left, 0)))
        self._end_s = math.inf if counted else min(meter.spent_s + settings.attempt_seconds, meter.budget.seconds)

    @property
    def left(self) -> int:
        """Transitions that may still be checked; none once the time is up."""
        if self._end_s < math.inf and self._meter.spent_s >= self._end_s:
            return 0
        return self._last - self._meter.extensions

    def charge(self, count: int) -> None:
        """Spend checked transitions."""
        self._meter.charge_extensions(count)


class Planner(ABC):
    """Looks for trusted actions that lead from a start to the goal."""

    @abstractmethod
    def plan(
        self, problem: Problem, start: Float[np.ndarray, " state"], meter: Meter, rng: np.random.Generator
    ) -> Plan:
        """One planning attempt from `start`; charges each checked transition to `meter`.

        With a counted budget the result depends on the arguments alone, not on the clock.
        """
