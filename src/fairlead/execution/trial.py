"""One trial of the paper (Fig. 1C): plan, execute the whole plan, look, plan again or recover.

A planner that runs out of time returns its best partial plan, which is executed too.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, final

import numpy as np
from jaxtyping import Float

from fairlead.core.answers import expect, expect_finite, expect_kind
from fairlead.core.budget import Budget, Clock, Meter
from fairlead.core.errors import FairleadError
from fairlead.core.records import ActionOutcome, Explained, Plan, PlanOutcome, TrialOutcome
from fairlead.core.roles import Environment, Goal, RecoveryPolicy, World
from fairlead.core.streams import stream
from fairlead.execution.trace import NoTrace, Recorder

MakePlan = Callable[[np.ndarray, Meter, np.random.Generator], Plan]

STUCK_PLANS = 100
"""A trial ends after so many stuck plans from one observed state: to go on would cost hardly more than wall time."""


class Protocol(Explained):
    """What happens when a trial is stuck and the recovery policy declines."""

    PAPER = ("paper", "The trial ends.")
    FAIR = ("fair", "It plans again with a fresh seed until the budget is spent, 100 times from one state at most.")


@dataclass(frozen=True)
class Task:
    """What decides in a trial, and where.

    plan: one planning attempt from a state, `lambda state, meter, rng: planner.plan(problem, state, meter, rng)`.
    cut_short: told each action that was stopped before its targets: the state before, the action, the state after.
    """

    environment: Environment
    goal: Goal
    plan: MakePlan
    recovery: RecoveryPolicy
    cut_short: Callable[[np.ndarray, np.ndarray, np.ndarray], object] = lambda before, action, after: None


@dataclass(frozen=True)
class TrialResult:
    """How a trial went.

    planning_s [s] is wall time and 0 under a counted budget, which reads no clock; execution_s [s] is simulated.
    reached_at_s [s] is when the goal was seen to be reached, None if it was not. first_plan_success and
    first_plan_error_m [m] are of the state after the first plan was executed whole (recovery may come before); None if
    the trial ended before that. action_outcomes counts how the actions ended, those of recovery included.
    """

    success: bool
    error_m: float
    planning_s: float
    execution_s: float
    extensions: int
    plans: int
    recovery_actions: int
    actions: int
    action_outcomes: dict[str, int]
    outcome: TrialOutcome
    first_plan_success: bool | None
    first_plan_error_m: float | None
    times_stuck: int
    reached_at_s: float | None

    def row(self) -> dict[str, Any]:
        """As JSON values."""
        return {**asdict(self), "outcome": self.outcome.label}


def run_trial(
    world: World,
    task: Task,
    budget: Budget,
    protocol: Protocol,
    seed: int,
    recorder: Recorder | None = None,
    clock: Clock = time.perf_counter,
) -> TrialResult:
    """Run one trial in `world`, a single copy.

    Every planning attempt and every recovery draws from its own stream under `seed`. With a counted budget the result
    is the same bit for bit whenever the world, the planner and the recovery are.

    Raises:
        FairleadError: the planner's or the world's answer has another shape than the role says, or is not finite.
        KeyboardInterrupt: passed on, after the trace has been ended as interrupted.
    """
    counted = math.isfinite(budget.extensions)
    task.recovery.forget()
    trial = _Trial(world, task, Meter(budget, (lambda: 0.0) if counted else clock), protocol, seed, recorder)
    trial.record_start()
    try:
        result = trial.result(trial.run())
    except KeyboardInterrupt:
        trial.record_end(trial.result(TrialOutcome.INTERRUPTED))
        raise
    trial.record_end(result)
    return result


@final
class _Trial:
    """A trial under way."""

    def __init__(
        self, world: World, task: Task, meter: Meter, protocol: Protocol, seed: int, recorder: Recorder | None
    ) -> None:
        self._world, self._task, self._meter, self._protocol, self._seed = world, task, meter, protocol, seed
        self._recorder = recorder or NoTrace()
        self._state: np.ndarray = world.observe()[0]
        self._plans = self._recoveries = self._stuck = self._stuck_here = 0
        self._ends: Counter[str] = Counter()
        self._first: tuple[bool, float] | None = None
        self._diverged = False

    def run(self) -> TrialOutcome:
        """The loop. Returns how the trial ended."""
        while True:
            if self._diverged:
                return TrialOutcome.DIVERGED
            if self._reached:
                return TrialOutcome.GOAL
            if self._meter.exhausted:
                return TrialOutcome.BUDGET
            plan = self._plan()
            if plan.outcome is not PlanOutcome.STUCK:
                self._follow(plan)
            elif not self._recover() and self._protocol is Protocol.PAPER:
                return TrialOutcome.STUCK
            if self._stuck_here == STUCK_PLANS:
                return TrialOutcome.STUCK

    @property
    def _error(self) -> float:
        return float(self._task.goal.error(self._state[None])[0])

    @property
    def _reached(self) -> bool:
        return bool(self._task.goal.reached(self._state[None])[0])

    def _plan(self) -> Plan:
        meter, index = self._meter, self._plans
        meter.start_planning()
        try:
            plan = self._task.plan(self._state, meter, stream(self._seed, "plan", index))
        finally:
            meter.stop_planning()
        self._look_at(plan)
        if not plan.extensions:
            # A planner that checks nothing must spend something, or a counted budget would never end.
            meter.charge_extensions(1)
        self._plans += 1
        self._recorder.plan({
            "event": "plan", "index": index, "outcome": plan.outcome.label, "steps": len(plan),
            "extensions": plan.extensions, "nodes": plan.nodes, "invalid": plan.invalid, "at_s": meter.spent_s,
        }, plan)  # fmt: skip
        return plan

    def _look_at(self, plan: Any) -> None:
        """FairleadError where a planner's answer is no plan that can be followed."""
        expect_kind("what the planner answered", plan, Plan)
        steps, layout = len(plan.actions), self._world.layout
        expect_finite(plan, "the actions", plan.actions, (steps, layout.action_size))
        expect_finite(plan, "the states", plan.states, (steps + 1, layout.state_size))
        expect(plan, "the trust", plan.trust, (steps,))

    def _follow(self, plan: Plan) -> None:
        """Execute a whole plan, or as much of it as the time allows."""
        for action in plan.actions:
            if self._meter.spent_s >= self._meter.budget.seconds or self._diverged:
                return
            self._execute(action, recovery=False)
        if self._first is None and not self._diverged:
            self._first = self._reached, self._error

    def _recover(self) -> bool:
        """One recovery action; false where the policy declines."""
        self._stuck += 1
        self._stuck_here += 1
        rng, recovery = stream(self._seed, "recovery", self._stuck - 1), self._task.recovery
        before = recovery.extensions
        self._meter.start_planning()
        try:
            actions = recovery.choose(self._task.environment, self._state[None], rng)
        finally:
            self._meter.stop_planning()
            self._meter.charge_extensions(recovery.extensions - before)
        if actions is None:
            return False
        if not self._meter.exhausted:
            self._recoveries += 1
            self._execute(actions[0], recovery=True)
        return True

    def _execute(self, action: Float[np.ndarray, " action"], recovery: bool) -> None:
        executed = self._world.execute(action[None])
        expect_finite(self._world, "an executed state", executed.states, (1, len(self._state)))
        expect_finite(self._world, "the seconds of an action", executed.seconds, (1,))
        expect(self._world, "the outcomes", executed.outcomes, (1,))
        if executed.outcomes[0] not in range(len(ActionOutcome)):
            raise FairleadError(
                f"{type(self._world).__name__}: an action ended in {executed.outcomes[0]}, no ActionOutcome"
            )
        if executed.seconds[0] < 0:
            raise FairleadError(f"{type(self._world).__name__}: an action took {executed.seconds[0]:.4g} s")
        seconds, self._diverged = float(executed.seconds[0]), bool(executed.diverged[0])
        end = tuple(ActionOutcome)[int(executed.outcomes[0])].label
        before, self._state = self._state, executed.states[0]
        if not np.array_equal(before, self._state):
            self._stuck_here = 0
        self._ends[end] += 1
        if end != ActionOutcome.TARGET.label:
            self._task.cut_short(before, action, self._state)
        self._meter.charge_execution(seconds)
        self._recorder.event({
            "event": "action", "plan": self._plans - 1, "recovery": recovery, "action": action.tolist(),
            "outcome": end, "seconds": seconds,
            "at_s": self._meter.spent_s, "state": self._state.tolist(), "error_m": self._error,
        })  # fmt: skip

    def result(self, outcome: TrialOutcome) -> TrialResult:
        """The result, when the trial ends with this outcome."""
        meter, success = self._meter, outcome is TrialOutcome.GOAL
        # An action under way when the time runs out is finished, and its end counts as the budget's last moment.
        reached_at = min(meter.spent_s, meter.budget.seconds) if success else None
        first_success, first_error = self._first or (None, None)
        return TrialResult(
            success=success,
            error_m=self._error,
            planning_s=meter.planning_s,
            execution_s=meter.execution_s,
            extensions=meter.extensions,
            plans=self._plans,
            recovery_actions=self._recoveries,
            actions=self._ends.total(),
            action_outcomes=dict(self._ends),
            outcome=outcome,
            first_plan_success=first_success,
            first_plan_error_m=first_error,
            times_stuck=self._stuck,
            reached_at_s=reached_at,
        )

    def record_start(self) -> None:
        """Open the trace."""
        layout = self._world.layout
        self._recorder.event({
            "event": "start", "state": self._state.tolist(), "error_m": self._error,
            "layout": {"grippers": layout.grippers, "points": layout.points},
        })  # fmt: skip

    def record_end(self, result: TrialResult) -> None:
        """Close the trace."""
        self._recorder.event({"event": "end", **result.row()})
