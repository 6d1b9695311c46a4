"""One trial from its names: scene, method and seed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, final

import numpy as np

from fairlead.core.answers import expect_kind
from fairlead.core.budget import Budget
from fairlead.core.errors import FairleadError
from fairlead.core.roles import World
from fairlead.core.streams import stream, stream_seed
from fairlead.evaluation.methods import Parts, find_method
from fairlead.evaluation.models import Models
from fairlead.evaluation.planners import find_planner
from fairlead.execution.trace import NoTrace, Recorder, TraceFolder
from fairlead.execution.trial import Protocol, Task, run_trial
from fairlead.planning.memory import CutShort
from fairlead.planning.problem import PAPER, Planner, Problem
from fairlead.scenarios.other_world import Differences, other_world, with_arms_of
from fairlead.scenarios.registry import scenario as find_scenario
from fairlead.scenarios.scene_files import Scene

Row = dict[str, Any]

START_RESIDUAL_M = 0.05
"""A start whose rope settles farther away than this [m] is not the scene's."""


@dataclass(frozen=True)
class TrialsConfig:
    """What to try.

    Args:
        scenario: name of the scenario.
        models: folder of the trained models, see `Models`.
        scenes: scene file.
        methods: names, in the order to run.
        budget: of each trial.
        protocol: what happens where a trial is stuck.
        planner: name of the planner, see `planners`.
        seeds: trial seeds; every method meets every scene with each of them.
        limit: only the first scenes, if not None.
        traced: traces are kept of the first seed in the first so many scenes.
        reference: the method that is compared with each of the others. None: what was stated for these trials before,
            else the first in the table of methods.
        differences: of the world of execution from that of training.
        remember: keep away from actions that were cut short in the same trial, in planning and recovery; the more there
            were hereabouts, the rather learned recovery acts at random.
        distilled: plan with the network that was distilled from the ensemble, where a method plans with the learned
            dynamics.
    """

    scenario: str
    models: Path
    scenes: Path
    methods: tuple[str, ...]
    budget: Budget
    protocol: Protocol = Protocol.FAIR
    planner: str = "rrt"
    seeds: tuple[int, ...] = (0,)
    limit: int | None = None
    traced: int = 5
    reference: str | None = None
    differences: Differences | None = None
    remember: bool = False
    distilled: bool = False

    def __post_init__(self) -> None:
        for name in ("methods", "seeds"):
            values = getattr(self, name)
            if not values or len(set(values)) < len(values):
                raise FairleadError(f"{name}: at least one is needed, and none twice; got {list(values)}")
        if self.limit is not None and self.limit < 1:
            raise FairleadError(f"limit {self.limit}: at least 1 scene is needed")
        if self.traced < 0:
            raise FairleadError(f"traced {self.traced}: no less than 0 scenes are needed")
        dynamics = [find_method(method).dynamics for method in self.methods]
        if self.distilled and "learned" not in dynamics:
            raise FairleadError("--distilled means nothing to these methods: none plans with the learned dynamics")


@dataclass(frozen=True)
class Job:
    """One trial by its names; its trace goes to `trace`, if anywhere."""

    method: str
    scene: str
    seed: int
    trace: Path | None


@final
class Bench:
    """Everything that trials of one configuration share.

    Raises:
        FairleadError: an unknown name, a bad scene, or a missing model, found before the first trial.
    """

    def __init__(self, config: TrialsConfig) -> None:
        self.config = config
        self.scenario = find_scenario(config.scenario)
        self.scenes = self.scenario.scenes(config.scenes)
        self._tried = CutShort(self.scenario.layout)
        planned_for = with_arms_of(self.scenario, config.differences)
        self.models = Models(config.models, planned_for, self._tried, config.remember, config.distilled)
        self._planner = find_planner(config.planner)
        self._parts = Parts(self.models)
        for method in config.methods:
            self._parts.build(find_method(method), self.scenes.scenes[0])

    def run(self, job: Job) -> Row:
        """Run one trial; the same job gives the same row when the budget is counted."""
        scenario, scene, method = self.scenario, self.scenes.scene(job.scene), find_method(job.method)
        dynamics, check, recovery = self._parts.build(method, scene)
        environment, goal = scenario.environment(scene.obstacles), scene.goal
        problem = Problem(environment, goal, dynamics, check, self.models.sampler)

        planner = self._planner(PAPER.scaled(method.budget_scale))
        expect_kind(f"planner '{self.config.planner}'", planner, Planner)
        plan = partial(planner.plan, problem)
        names = {
            "scenario": scenario.name,
            "scenes": self.scenes.name,
            "scene": scene.name,
            "method": job.method,
            "seed": job.seed,
        }
        budget = scaled(self.config.budget, method.budget_scale)
        world, residual = self._world(scene, job.seed)
        if not residual <= START_RESIDUAL_M:  # nor NaN
            raise FairleadError(
                f"scene '{scene.name}': the rope comes to rest {residual:.3f} m from where it is laid, more than "
                f"{START_RESIDUAL_M}: are its points a link apart, and the grippers at its ends?"
            )
        seed = stream_seed(job.seed, "trial", scenario.name, scene.name)
        self._tried.forget()
        task = Task(environment, goal, plan, recovery, self._tried.add)
        result = run_trial(world, task, budget, self.config.protocol, seed, _recorder(job, names))
        about = {"budget": str(budget), "protocol": self.config.protocol.label}
        return names | result.row() | about | {"start_residual_m": round(residual, 6)}

    def _world(self, scene: Scene, seed: int) -> tuple[World, float]:
        """The world of a trial, and how far from the scene's points its rope has settled [m]."""
        start, differences = scene.state(self.scenario.layout), self.config.differences
        if differences is None:
            world = self.scenario.simulate([scene.obstacles], start[None])
            return world, float(world.residual[0])
        rng = stream(seed, "other world", self.scenario.name, scene.name)
        other = other_world(self.scenario, scene.obstacles, start, differences, rng)
        return other, float(other.inner.residual[0])


def scaled(budget: Budget, factor: float) -> Budget:
    """A budget so many times as large."""
    if np.isfinite(budget.seconds):
        return replace(budget, seconds=budget.seconds * factor)
    return replace(budget, extensions=budget.extensions * factor)


def _recorder(job: Job, names: Row) -> Recorder:
    return NoTrace() if job.trace is None else TraceFolder(job.trace, names)
