"""How fast collection simulates, against bare steps of the same model and threads, from the same states."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any, final

import mujoco.batch
import numpy as np

from benchmarks.rates import Rates
from fairlead.data.collect import CollectConfig, collect
from fairlead.scenarios.scenario import Scenario

FIELDS = ("qpos", "qvel", "qacc_warmstart", "ctrl", "mocap_pos")
"""What a step depends on and collection changes."""
EVERY, WINDOW = 400, 20
"""Of so many steps of collection, so many in a row are made again, bare."""


@final
class Bare:
    """Makes steps of a simulation again with `Batch.step` alone, all copies at once.

    They are made while collection rests, all through it, so that both see the same machine; the first of a window is
    not timed, for collection has had the caches until then.
    """

    def __init__(self, simulation: Any, threads: int) -> None:
        copies = len(simulation.qpos)
        self._batch = mujoco.batch.Batch(simulation.model, copies, threads)
        self._batch.mocap_quat = simulation.batch.mocap_quat.copy()
        self._theirs, self._ours = ([b.bind(field) for field in FIELDS] for b in (simulation.batch, self._batch))
        self._everyone, self._count = np.arange(copies, dtype=np.int32), 0
        self._noted: list[list[np.ndarray]] = []
        self.steps, self.seconds, self.paused = 0, 0.0, 0.0

    def before_step(self) -> None:
        """Note the step that collection is about to make, or make again those that were noted."""
        begun = time.perf_counter()
        if self._count % EVERY < WINDOW:
            self._noted.append([field.copy() for field in self._theirs])
        for i, noted in enumerate(self._noted if len(self._noted) == WINDOW else ()):
            self._again(noted, timed=i > 0)
        self._noted = self._noted[: len(self._noted) % WINDOW]
        self._count += 1
        self.paused += time.perf_counter() - begun

    def _again(self, noted: list[np.ndarray], timed: bool) -> None:
        for field, value in zip(self._ours, noted, strict=True):
            field[:] = value
        begun = time.perf_counter()
        self._batch.step(self._everyone, 1)
        self.seconds += timed * (time.perf_counter() - begun)
        self.steps += timed * len(self._everyone)


def collect_vs_raw(scenario: Scenario, lanes: int, steps: int, threads: int, trajectories: int = 8) -> Rates:
    """Simulation steps a second of `collect` (phase 2) over those of bare steps.

    Everything is included: placing the obstacles, beginning trajectories and actions, waiting for the last lane, files.
    """
    simulate, made = scenario.simulate, []

    def watched(*arguments: Any) -> Any:
        world: Any = simulate(*arguments)
        bare, step = Bare(world.simulation, threads), world.simulation.step

        def stepping(ids: np.ndarray, count: int = 1) -> None:
            bare.before_step()
            step(ids, count)

        world.simulation.step = stepping
        made.append(bare)
        return world

    config = CollectConfig(phase=2, trajectories=trajectories * lanes, lanes=lanes, steps=steps)
    scenario.simulate = watched
    try:
        with tempfile.TemporaryDirectory() as folder:
            begun = time.perf_counter()
            manifest = collect(scenario, config, Path(folder) / "dataset", threads)
            seconds = time.perf_counter() - begun - sum(bare.paused for bare in made)
    finally:
        scenario.simulate = simulate
    # The last world is that of the lanes; one before it may have arranged their obstacles.
    ours, raw = manifest.extra["simulation_steps"] / seconds, made[-1].steps / made[-1].seconds
    return Rates(ours / raw, ours, raw)
