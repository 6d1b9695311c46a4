"""OMPL's control RRT (Sucan, Moll and Kavraki, 2012) on the same roles: one transition at a time.

OMPL grows the tree and finds nearest nodes. Its Python bindings let a program supply the propagation, the goal and the
goal's samples, but not the samplers of states and controls. So every target is drawn as a goal sample (a goal bias of
1), from the same distribution as our own planner's, and OMPL's control is only a number whose change asks for a new
action. OMPL propagates what it extends by twice, to find out how far it goes and then for the states on the way: the
second time costs nothing and gives the same.
"""

from __future__ import annotations

from typing import Any, final

import numpy as np
from jaxtyping import Float
from ompl import base, control, util  # pyright: ignore[reportMissingTypeStubs]

from fairlead.core.budget import Meter
from fairlead.core.records import Plan, PlanOutcome
from fairlead.planning.metric import metric_groups
from fairlead.planning.problem import PAPER, Allowance, Planner, Problem, SearchSettings
from fairlead.planning.targets import Targets
from fairlead.planning.tree import Tree

_BOUND = 1e3


@final
class OmplRRT(Planner):
    """`ompl.control.RRT` with intermediate states.

    OMPL seeds its generators from one per process. That one is set at the start of every attempt, so attempts are
    reproducible as long as a process makes one at a time.

    Args:
        settings: what it shares with every planner.
    """

    def __init__(self, settings: SearchSettings = PAPER) -> None:
        self.settings = settings

    def plan(
        self, problem: Problem, start: Float[np.ndarray, " state"], meter: Meter, rng: np.random.Generator
    ) -> Plan:
        # OMPL complains when it is seeded twice, and yet does what is asked.
        util.setLogLevel(util.LogLevel.LOG_NONE)
        util.RNG.setSeed(int(rng.integers(1, 2**31)))
        before = meter.extensions
        search = _Search(problem, start, self.settings, meter, rng)
        if search.outcome is None:
            _solve(problem, start, search, self.settings.repeats)
        assert search.outcome is not None
        return search.tree.plan(search.outcome, meter.extensions - before, search.invalid)


@final
class _Search:
    """What OMPL calls back: propagation through the roles, recorded in our own tree."""

    def __init__(
        self,
        problem: Problem,
        start: Float[np.ndarray, " state"],
        settings: SearchSettings,
        meter: Meter,
        rng: np.random.Generator,
    ) -> None:
        self._problem, self._rng = problem, rng
        self._allowance, self._stuck_attempts = Allowance(settings, meter), settings.stuck_attempts
        self._places = [(i, j) for i, size in enumerate(metric_groups(problem.layout)) for j in range(size)]
        self._targets = Targets(problem, start, settings.goal_bias)
        self.tree = Tree(problem, start)
        self._nodes = {self.tree.states[0].tobytes(): 0}
        self._children: dict[tuple[int, float], int] = {}
        self._control, self._origin = -1.0, self.tree.states
        self._action: np.ndarray = np.zeros((1, problem.layout.action_size))
        self._tried = 0
        self.valid, self.invalid = True, 0

    @property
    def outcome(self) -> PlanOutcome | None:
        """How the search ends, or None: it goes on."""
        if self.tree.goal_reached:
            return PlanOutcome.GOAL
        if len(self.tree) == 1 and self._tried >= self._stuck_attempts:
            return PlanOutcome.STUCK
        return PlanOutcome.PARTIAL if self._allowance.left <= 0 else None

    def read(self, state: Any) -> Float[np.ndarray, "1 state"]:
        """A state of OMPL's as a row."""
        return np.array([[state[i][j] for i, j in self._places]])

    def write(self, state: Any, values: Float[np.ndarray, " state"]) -> None:
        """Set a state of OMPL's."""
        for (i, j), value in zip(self._places, values.tolist(), strict=True):
            state[i][j] = value

    def propagate(self, state: Any, number: Any, _duration: float, result: Any) -> None:
        """One step: repeats the last action where OMPL repeats its control, else draws a new one."""
        self.valid = False
        if self.outcome is not None:
            return
        states = self.read(state)
        node = self._nodes[states.tobytes()]
        if known := self._children.get((node, number[0])):
            self.valid = True
            self.write(result, self.tree.states[known])
            return
        sampler = self._problem.sampler
        if number[0] == self._control:
            action = sampler.repeat(self._origin, self._action, states)
        else:
            action = sampler.propose(states, self._rng)
        self._control, self._origin, self._action = number[0], states, action
        tried = self._problem.attempt(states, action, self.tree.encodings[[node]])
        self._allowance.charge(1)
        self._tried += 1
        self.invalid += tried.invalid
        self.valid = bool(tried.accepted[0])
        if self.valid:
            new = int(self.tree.add(np.array([node]), action, tried, tried.accepted)[0])
            reached = self.tree.states[new]
            self._nodes[reached.tobytes()] = self._children[node, number[0]] = new
            self.write(result, reached)

    def sample_target(self, state: Any) -> None:
        """A state to steer to."""
        self.write(state, self._targets.sample(1, self._rng)[0])

    def goal_error(self, state: Any) -> float:
        """Goal error of a state of OMPL's [m]."""
        return float(self._problem.goal.error(self.read(state))[0])


@final
class _Goal(base.GoalSampleableRegion):
    """Steers to targets; nothing satisfies it, since the search itself sees when the goal is reached."""

    def __init__(self, information: Any, search: _Search) -> None:
        super().__init__(information)
        self._search = search
        self.setThreshold(-1.0)

    def distanceGoal(self, state: Any) -> float:
        return self._search.goal_error(state)

    def sampleGoal(self, state: Any) -> None:
        self._search.sample_target(state)

    def maxSampleCount(self) -> int:
        return 2**31 - 1

    def couldSample(self) -> bool:
        return True


def _solve(problem: Problem, start: Float[np.ndarray, " state"], search: _Search, repeats: int) -> None:
    """Let OMPL run until the search has an outcome. Nothing that OMPL holds may hold OMPL, or neither is freed."""
    space = base.CompoundStateSpace()
    for size in metric_groups(problem.layout):
        part = base.RealVectorStateSpace(size)
        part.setBounds(_box(size, -_BOUND, _BOUND))
        space.addSubspace(part, 1.0)
    controls = control.RealVectorControlSpace(space, 1)
    controls.setBounds(_box(1, 0.0, 1.0))
    information = control.SpaceInformation(space, controls)
    information.setStatePropagator(search.propagate)
    information.setStateValidityChecker(lambda _: search.valid)
    information.setMinMaxControlDuration(1, repeats)
    information.setPropagationStepSize(1.0)
    information.setup()
    definition = base.ProblemDefinition(information)
    root = space.allocState()
    search.write(root, np.asarray(start, float))
    definition.addStartState(root)
    definition.setGoal(_Goal(information, search))
    planner = control.RRT(information)
    planner.setProblemDefinition(definition)
    planner.setIntermediateStates(True)
    planner.setGoalBias(1.0)
    planner.setup()
    planner.solve(base.PlannerTerminationCondition(lambda: search.outcome is not None))
    planner.clear()


def _box(size: int, low: float, high: float) -> Any:
    bounds = base.RealVectorBounds(size)
    bounds.setLow(low)
    bounds.setHigh(high)
    return bounds
