"""Laws of a trial: what ends it, what it spends, what it records, and what a trace tells however it ended."""

from __future__ import annotations

import itertools
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import final

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fairlead.core.artifacts import read_jsonl
from fairlead.core.budget import Budget
from fairlead.core.errors import ArtifactError, FairleadError
from fairlead.core.records import Executed, Plan, PlanOutcome, TrialOutcome
from fairlead.core.roles import Goal, RecoveryPolicy, World
from fairlead.core.traces import EVENTS, read_trace
from fairlead.execution.trace import TraceFolder
from fairlead.execution.trial import STUCK_PLANS, Protocol, Task, TrialResult, run_trial
from fairlead.planning.recovery import NoRecovery, RandomRecovery
from fairlead.planning.rrt import BatchedRRT
from toy import BAR, LAYOUT, SAMPLER, ToyWorld, arena, problem, straight, tail_goal

START = straight(-0.4, 0.0)
COUNTED = Budget(extensions=30_000)
GOAL = tail_goal(0.5, 0.1)


def toy_task(recovery=None, goal=GOAL, lanes: int = 32) -> Task:
    environment, planner = arena(BAR), BatchedRRT(lanes=lanes)
    asked = problem(environment, goal)
    return Task(environment, goal, lambda s, m, r: planner.plan(asked, s, m, r), recovery or NoRecovery())


def scripted_task(plans, recovery=None, goal=GOAL, cost: int = 100) -> Task:
    """Plans from a script: a number of random steps each, None for stuck."""
    script = iter(plans)

    def make(state, meter, rng):
        steps = next(script)
        meter.charge_extensions(cost)
        outcome = PlanOutcome.STUCK if steps is None else PlanOutcome.PARTIAL
        actions = SAMPLER.propose(np.repeat(state[None], steps or 0, axis=0), rng)
        states = np.repeat(state[None], len(actions) + 1, axis=0)
        return Plan(outcome, states, actions, np.ones(len(actions)), cost, 1)

    return Task(arena(), goal, make, recovery or NoRecovery())


def trial(task, budget=COUNTED, protocol=Protocol.PAPER, seed=0, world=None, **rest) -> TrialResult:
    return run_trial(world or ToyWorld(arena(BAR), START[None]), task, budget, protocol, seed, **rest)


@given(seed=st.integers(0, 2**32))
@settings(max_examples=4, deadline=None)
def test_a_trial_ends_in_the_goal_or_with_the_budget_and_can_be_repeated(seed):
    def clock() -> float:
        raise AssertionError("the clock was read under a counted budget")

    world = ToyWorld(arena(BAR), START[None])
    result = trial(toy_task(), seed=seed, world=world, clock=clock)
    assert result.success == (result.outcome is TrialOutcome.GOAL) == bool(GOAL.reached(world.observe()[0]))
    assert result.error_m == GOAL.error(world.observe()[0])
    assert result.actions == world.executed
    assert result.execution_s == result.actions
    assert result.extensions <= COUNTED.extensions
    assert result.success or result.extensions == COUNTED.extensions
    assert (result.reached_at_s is not None) == result.success
    assert result.row() == trial(toy_task(), seed=seed).row()


def test_the_first_plan_is_judged_after_it_was_executed_whole():
    solved = trial(toy_task())
    assert solved.success
    assert solved.plans == 1
    assert (solved.first_plan_success, solved.first_plan_error_m) == (True, solved.error_m)
    at_goal = trial(toy_task(goal=tail_goal(-0.7, 0.0)))
    assert (at_goal.plans, at_goal.reached_at_s, at_goal.first_plan_success) == (0, 0.0, None)
    stuck = trial(scripted_task([None]))
    assert (stuck.times_stuck > 0, stuck.first_plan_success, stuck.first_plan_error_m) == (True, None, None)
    recovered = trial(scripted_task([None, 3], RandomRecovery(SAMPLER)), Budget(extensions=200))
    assert recovered.times_stuck == 1
    assert recovered.first_plan_error_m not in (None, GOAL.error(START))
    goes_on = trial(scripted_task([0, 3]), Budget(extensions=200))
    assert goes_on.first_plan_error_m == GOAL.error(START) != goes_on.error_m
    cut = trial(scripted_task([9]), Budget(seconds=3.5), clock=lambda: 0.0)
    assert (cut.actions, cut.first_plan_success, cut.first_plan_error_m) == (4, None, None)


PLAN = Plan(PlanOutcome.GOAL, np.stack([START, START]), START[None, :3], np.ones(1), 1, 2)


@pytest.mark.parametrize(
    ("plan", "said"),
    [
        (None, "the planner answered is a NoneType"),
        (replace(PLAN, states=PLAN.states[1:]), r"states must be an array of shape \(2, 12\), not \(1, 12\)"),
        (replace(PLAN, actions=PLAN.actions * np.nan), "actions must be finite"),
    ],
)
def test_what_is_no_plan_is_not_followed(plan, said):
    world = ToyWorld(arena(BAR), START[None])
    with pytest.raises(FairleadError, match=said):
        trial(Task(arena(BAR), GOAL, lambda s, m, r: plan, NoRecovery()), world=world)
    assert world.executed == 0


@final
class Odd(World):
    """Answers as it is told to."""

    layout = LAYOUT

    def __init__(self, answer):
        self.answer = answer

    def observe(self):
        return START[None]

    def execute(self, actions):
        return self.answer


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (Executed(START[None] * np.nan, np.ones(1), np.zeros(1, int)), "Odd: an executed state must be finite"),
        (Executed(START[None, :9], np.ones(1), np.zeros(1, int)), r"Odd: an executed state .* \(1, 12\), not \(1, 9\)"),
        (Executed(START[None], -np.ones(1), np.zeros(1, int)), "Odd: an action took -1 s"),
        (Executed(START[None], np.ones(1), np.array([6])), "Odd: an action ended in 6, no ActionOutcome"),
        (Executed(START[None], np.ones(1), np.array([-1])), "Odd: an action ended in -1, no ActionOutcome"),
    ],
)
def test_what_no_world_can_do_ends_the_trial(answer, said):
    with pytest.raises(FairleadError, match=said):
        trial(scripted_task([2]), world=Odd(answer))


def test_stuck_ends_the_paper_protocol_and_not_the_fair_one():
    paper = trial(scripted_task([2, None, 3]))
    assert (paper.outcome, paper.plans, paper.times_stuck, paper.actions) == (TrialOutcome.STUCK, 2, 1, 2)
    fair = trial(scripted_task([None, 2, None, 3]), Budget(extensions=400), Protocol.FAIR)
    assert (fair.outcome, fair.plans, fair.times_stuck, fair.actions) == (TrialOutcome.BUDGET, 4, 2, 5)


@final
class Rooted(World):
    """Nothing moves, and no time passes."""

    layout = LAYOUT

    def observe(self):
        return START[None]

    def execute(self, actions):
        return Executed(self.observe(), np.zeros(1), np.array([1]))


@pytest.mark.parametrize("recovery", [NoRecovery(), RandomRecovery(SAMPLER)])
def test_who_is_stuck_for_ever_stops_long_before_the_budget_is_spent(recovery):
    task = scripted_task(itertools.repeat(None), recovery, cost=32)
    result = trial(task, Budget(seconds=180), Protocol.FAIR, world=Rooted(), clock=lambda: 0.0)
    assert (result.outcome, result.plans, result.times_stuck) == (TrialOutcome.STUCK, STUCK_PLANS, STUCK_PLANS)
    assert f"{STUCK_PLANS} times" in Protocol.FAIR.sentence


def test_plans_that_are_stuck_elsewhere_do_not_count():
    almost = (STUCK_PLANS - 1) * [None]
    result = trial(scripted_task([*almost, 1, *almost, 2]), Budget(extensions=100 * 2 * STUCK_PLANS), Protocol.FAIR)
    assert (result.outcome, result.actions) == (TrialOutcome.BUDGET, 3)


@pytest.mark.parametrize("protocol", list(Protocol))
def test_recovery_is_one_action_then_a_new_plan(protocol):
    result = trial(scripted_task([None, None, 2], RandomRecovery(SAMPLER)), Budget(extensions=300), protocol)
    assert (result.outcome, result.times_stuck, result.recovery_actions) == (TrialOutcome.BUDGET, 2, 2)
    assert (result.plans, result.actions) == (3, 4)


def test_who_remembers_is_told_what_was_cut_short_and_nothing_else():
    told, world = [], ToyWorld(arena(BAR), START[None])
    task = replace(scripted_task(itertools.repeat(3), cost=1), cut_short=lambda *action: told.append(action))
    result = trial(task, Budget(extensions=40), world=world)
    assert 0 < len(told) == result.actions - result.action_outcomes["target"]
    for before, action, after in told:
        np.testing.assert_array_equal(before, after)  # the toy's world stays where it is
        assert not np.array_equal(action, before[:3])


def test_what_recovery_checks_is_charged():
    class Costly(RecoveryPolicy):
        def choose(self, environment, states, rng):
            self.extensions += 40
            return SAMPLER.propose(states, rng)

    result = trial(scripted_task([None, None, 2], Costly()), Budget(extensions=380))
    assert (result.recovery_actions, result.extensions) == (2, 380)


def test_plans_without_actions_do_not_run_for_ever():
    costless = trial(scripted_task(itertools.repeat(0), cost=0), Budget(extensions=50))
    assert (costless.outcome, costless.plans, costless.actions) == (TrialOutcome.BUDGET, 50, 0)


def test_execution_stops_when_the_seconds_are_spent():
    ticks = itertools.count(step=0.25)
    result = trial(scripted_task(itertools.repeat(7)), Budget(seconds=12.0), clock=lambda: next(ticks))
    assert result.outcome is TrialOutcome.BUDGET
    assert 12.0 <= result.planning_s + result.execution_s < 13.5


@final
class AfterActions(Goal):
    """Reached once the world has executed so many actions."""

    def __init__(self, world: ToyWorld, actions: int) -> None:
        self.world, self.actions = world, actions

    tolerance = 0.0

    def error(self, states):
        return np.full(states.shape[:-1], float(self.actions - self.world.executed))

    def sample(self, states, rng):
        return states


@pytest.mark.parametrize(("needed", "reached_at"), [(3, 3.5), (4, 3.5), (5, None)])
def test_the_action_under_way_when_time_runs_out_still_counts(needed, reached_at):
    world = ToyWorld(arena(BAR), START[None])
    task = scripted_task([9], goal=AfterActions(world, needed))
    result = trial(task, Budget(seconds=3.5), world=world, clock=lambda: 0.0)
    assert (result.actions, result.reached_at_s, result.success) == (4, reached_at, reached_at is not None)


def test_every_attempt_draws_from_a_stream_of_its_own():
    drawn = []

    def make(state, meter, rng):
        drawn.append(rng.integers(2**62))
        meter.charge_extensions(1)
        return Plan(PlanOutcome.STUCK, state[None], np.zeros((0, 3)), np.zeros(0), 1, 1)

    task = Task(arena(), GOAL, make, NoRecovery())
    trial(task, Budget(extensions=20), Protocol.FAIR, seed=1)
    trial(task, Budget(extensions=20), Protocol.FAIR, seed=2)
    assert len(set(drawn)) == 40


def test_a_diverged_simulation_ends_the_trial():
    result = trial(scripted_task([5, 5]), world=ToyWorld(arena(BAR), START[None], diverge_after=3))
    assert (result.outcome, result.actions, result.success) == (TrialOutcome.DIVERGED, 4, False)


def test_a_trace_tells_the_trial(tmp_path: Path):
    world = ToyWorld(arena(BAR), START[None])
    task = toy_task(RandomRecovery(SAMPLER))
    result = trial(task, world=world, recorder=TraceFolder(tmp_path, {"scene": "toy", "seed": 0}))
    trace = read_trace(tmp_path)
    assert trace.about == {"scene": "toy", "seed": 0}
    assert trace.result == result.row()
    assert trace.layout == LAYOUT
    assert (trace.outcome, len(trace.plans), len(trace.actions)) == (result.outcome, result.plans, result.actions)
    assert np.allclose(trace.start, START)
    assert np.allclose(trace.actions[-1].state, world.observe()[0])
    assert sum(action.seconds for action in trace.actions) == result.execution_s
    plan = trace.plans[0]
    assert np.allclose([action.action for action in trace.actions if action.plan == 0], plan.actions)
    assert plan.states.dtype == plan.tree.states.dtype == np.float32
    assert (plan.tree.parents[1:] < np.arange(1, len(plan.tree.parents))).all()
    assert {tuple(state) for state in plan.states} <= {tuple(state) for state in plan.tree.states}
    with pytest.raises(ArtifactError):
        TraceFolder(tmp_path, {})


def test_a_stuck_plan_and_a_plan_without_a_tree_are_traced_too(tmp_path: Path):
    trial(scripted_task([None, 4], RandomRecovery(SAMPLER)), Budget(extensions=200), recorder=TraceFolder(tmp_path, {}))
    stuck, plan = read_trace(tmp_path).plans
    assert (stuck.outcome, len(stuck.actions)) == (PlanOutcome.STUCK, 0)
    assert plan.tree.parents.tolist() == [0, 0, 1, 2, 3]
    assert [action.recovery for action in read_trace(tmp_path).actions] == [True] + 4 * [False]


@final
class Interrupted(World):
    """A person presses Ctrl-C in the n-th call, before or after the action took place."""

    layout = LAYOUT

    def __init__(self, call: int, after: bool) -> None:
        self.world, self.call, self.after, self.calls = ToyWorld(arena(BAR), START[None]), call, after, 0

    def observe(self):
        return self.world.observe()

    def execute(self, actions):
        self.calls += 1
        if self.calls == self.call and not self.after:
            raise KeyboardInterrupt
        executed = self.world.execute(actions)
        if self.calls == self.call:
            raise KeyboardInterrupt
        return executed


@given(call=st.integers(1, 12), after=st.booleans(), plans=st.lists(st.none() | st.integers(1, 4), min_size=12))
@settings(max_examples=20, deadline=None)
def test_an_interrupt_while_executing_leaves_a_readable_trace(tmp_path_factory, call, after, plans):
    folder = tmp_path_factory.mktemp("trace")
    task = scripted_task(plans, RandomRecovery(SAMPLER), tail_goal(9, 9))
    with pytest.raises(KeyboardInterrupt):
        trial(task, world=Interrupted(call, after), recorder=TraceFolder(folder, {}))
    trace = read_trace(folder)
    assert trace.outcome is TrialOutcome.INTERRUPTED
    assert trace.result["actions"] == len(trace.actions) == call - 1


@given(plans=st.lists(st.integers(1, 4), max_size=5))
@settings(max_examples=10, deadline=None)
def test_an_interrupt_while_planning_leaves_a_readable_trace(tmp_path_factory, plans):
    def interrupted():
        yield from plans
        raise KeyboardInterrupt

    folder = tmp_path_factory.mktemp("trace")
    with pytest.raises(KeyboardInterrupt):
        trial(scripted_task(interrupted(), goal=tail_goal(9, 9)), recorder=TraceFolder(folder, {}))
    trace = read_trace(folder)
    assert trace.outcome is TrialOutcome.INTERRUPTED
    assert (len(trace.plans), len(trace.actions)) == (len(plans), sum(plans))


@pytest.mark.parametrize("damage", ["start", "arrays"])
def test_a_damaged_trace_is_named(tmp_path: Path, damage: str) -> None:
    trial(scripted_task([3], goal=tail_goal(9, 9)), Budget(extensions=3), recorder=TraceFolder(tmp_path, {}))
    assert read_trace(tmp_path).plans
    if damage == "start":
        (tmp_path / EVENTS).write_text((tmp_path / EVENTS).read_text().replace('"layout"', '"lay"', 1))
    else:
        for path in tmp_path.glob("*.npz"):
            path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(ArtifactError, match="damaged"):
        read_trace(tmp_path)


ENDLESS = """
import sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from test_execution import SAMPLER, Budget, RandomRecovery, TraceFolder, itertools, scripted_task, tail_goal, trial
plans = itertools.cycle([3, None, 2])
task = scripted_task(plans, RandomRecovery(SAMPLER), tail_goal(9, 9), cost=1)
trial(task, Budget(extensions=10**9), recorder=TraceFolder(Path(sys.argv[1]), {{"scene": "endless"}}))
"""


@pytest.mark.parametrize("stop", [signal.SIGKILL, signal.SIGINT])
@pytest.mark.parametrize("lines", [3, 57])
def test_a_killed_process_leaves_a_readable_trace(tmp_path: Path, stop, lines):
    script = ENDLESS.format(tests=str(Path(__file__).parent))
    process = subprocess.Popen([sys.executable, "-c", script, str(tmp_path / "t")], stderr=subprocess.DEVNULL)
    try:
        while len(list(read_jsonl(tmp_path / "t" / EVENTS))) < lines:
            assert process.poll() is None
            time.sleep(0.01)
    finally:
        process.send_signal(stop)
        try:
            process.wait(20)
        finally:
            process.kill()
    trace = read_trace(tmp_path / "t")
    assert trace.outcome is TrialOutcome.INTERRUPTED
    assert len(trace.plans) + len(trace.actions) >= lines - 2
    assert (stop is signal.SIGINT) == bool(trace.result)


def test_a_folder_without_a_trace_is_named(tmp_path: Path):
    with pytest.raises(ArtifactError, match=r"events\.jsonl"):
        read_trace(tmp_path)
