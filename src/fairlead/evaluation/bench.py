"""One trial from its names, and many of them in parallel processes."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, final

import numpy as np

from fairlead.core import plugins
from fairlead.core.budget import Budget
from fairlead.core.errors import FairleadError
from fairlead.core.streams import stream_seed
from fairlead.evaluation.methods import Models, Parts, find_method
from fairlead.execution.trace import NoTrace, Recorder, TraceFolder
from fairlead.execution.trial import Protocol, Task, run_trial
from fairlead.planning.ompl import OmplRRT
from fairlead.planning.problem import Planner, Problem
from fairlead.planning.rrt import BatchedRRT
from fairlead.scenarios.registry import scenario as find_scenario

Row = dict[str, Any]

PLANNERS: dict[str, Callable[[], Planner]] = {"rrt": BatchedRRT, "ompl": OmplRRT}
"""Others come by entry points in `fairlead.planners`."""


@dataclass(frozen=True)
class TrialsConfig:
    """What to try.

    Args:
        scenario: name of the scenario.
        models: folder of the trained models, see `Models`.
        scenes: scene file.
        methods: names, in the order to report; the first is compared with the others.
        budget: of each trial.
        protocol: what happens where a trial is stuck.
        planner: name of the planner.
        seeds: trial seeds; every method meets every scene with each of them.
        limit: only the first scenes, if not None.
        traced: traces are kept of the first seed in the first so many scenes.
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

    def __post_init__(self) -> None:
        for name in ("methods", "seeds"):
            values = getattr(self, name)
            if not values or len(set(values)) < len(values):
                raise FairleadError(f"{name}: at least one is needed, and none twice; got {list(values)}")
        if self.limit is not None and self.limit < 1:
            raise FairleadError(f"limit {self.limit}: at least 1 scene is needed")
        for method in self.methods:
            find_method(method)


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
        self.models = Models(config.models, self.scenario)
        self.planner: Planner = plugins.find("planner", config.planner, PLANNERS)()
        self._parts = Parts(self.models)
        for method in config.methods:
            self._parts.build(find_method(method), self.scenes.scenes[0])

    def run(self, job: Job) -> Row:
        """Run one trial; the same job gives the same row when the budget is counted."""
        scenario, scene, method = self.scenario, self.scenes.scene(job.scene), find_method(job.method)
        dynamics, check, recovery = self._parts.build(method, scene)
        environment, goal = scenario.environment(scene.obstacles), scenario.goal(scene)
        problem = Problem(environment, goal, dynamics, check, scenario.sampler)

        def plan(state: np.ndarray, meter: Any, rng: np.random.Generator) -> Any:
            return self.planner.plan(problem, state, meter, rng)

        names = {
            "scenario": scenario.name,
            "scenes": self.scenes.name,
            "scene": scene.name,
            "method": job.method,
            "seed": job.seed,
        }
        budget = scaled(self.config.budget, method.budget_scale)
        world = scenario.simulate([scene.obstacles], scene.state(scenario.layout)[None])
        seed = stream_seed(job.seed, "trial", scenario.name, scene.name)
        task = Task(environment, goal, plan, recovery)
        result = run_trial(world, task, budget, self.config.protocol, seed, _recorder(job, names))
        about = {"budget": str(budget), "protocol": self.config.protocol.label}
        return names | result.row() | about | {"start_residual_m": round(float(world.residual[0]), 6)}


def scaled(budget: Budget, factor: float) -> Budget:
    """A budget so many times as large."""
    if np.isfinite(budget.seconds):
        return replace(budget, seconds=budget.seconds * factor)
    return replace(budget, extensions=budget.extensions * factor)


def _recorder(job: Job, names: Row) -> Recorder:
    """A fresh trace: what a killed trial left there goes."""
    if job.trace is None:
        return NoTrace()
    shutil.rmtree(job.trace, ignore_errors=True)
    return TraceFolder(job.trace, names)


_bench: Bench | None = None
"""The bench of a worker process, made once by `_start`."""


def _start(config: TrialsConfig) -> None:
    global _bench
    # An interrupt from the keyboard reaches every process; the parent alone answers it, and stops its workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    _bench = Bench(config)


def _leave_with_parent() -> None:
    """A worker whose parent was killed must not write on into a folder that another run may have taken over."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _run(job: Job) -> Row:
    assert _bench is not None
    try:
        return _bench.run(job)
    except FairleadError as error:
        # An error with a constructor of its own cannot travel between processes; its sentence can.
        raise FairleadError(str(error)) from None


def run_jobs(config: TrialsConfig, jobs: Sequence[Job], workers: int) -> Iterator[Row]:
    """The rows of the jobs as they end, from `workers` processes with one computing thread each.

    Left early, by an error or an interrupt, it stops the processes; trials under way are lost.
    """
    if workers < 1:
        raise FairleadError(f"workers {workers}: at least 1 is needed")
    if not jobs:
        return
    os.environ["OMP_NUM_THREADS"] = "1"  # read by numpy and torch when the processes start
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(workers, len(jobs)), context, _start, (config,))
    try:
        for future in as_completed([pool.submit(_run, job) for job in jobs]):
            yield future.result()
    finally:
        for process in multiprocessing.active_children():
            process.terminate()
        pool.shutdown(wait=False, cancel_futures=True)
