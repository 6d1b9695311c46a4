"""How fast collection simulates, against bare steps of the same model, threads and controls."""

from __future__ import annotations

import json
import shutil
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.rates import Rates
from fairlead.data.collect import CollectConfig, collect
from fairlead.data.recording import PROGRESS
from fairlead.scenarios.scenario import Scenario


@dataclass(frozen=True)
class Recorded:
    """A simulation as it was after it was made, and what drove its steps until a copy had its trajectory done.

    What drives a step: the controls, and the positions of the bodies that are moved.
    """

    simulation: Any
    qpos: np.ndarray
    qvel: np.ndarray
    driven: list[tuple[np.ndarray, np.ndarray]]

    def bare_rate(self) -> float:
        """Steps a second of `Batch.step` alone, all simulations at once, driven as recorded."""
        simulation, everyone = self.simulation, np.arange(len(self.qpos), dtype=np.int32)
        moved = simulation.batch.bind("mocap_pos")
        simulation.qpos[:], simulation.qvel[:] = self.qpos, self.qvel
        begun = time.perf_counter()
        for control, position in self.driven:
            simulation.ctrl[:], moved[:] = control, position
            simulation.batch.step(everyone, 1)
        return len(self.qpos) * len(self.driven) / (time.perf_counter() - begun)


class _Enough(Exception):
    """The first shard is there."""


def _first_shard(scenario: Scenario, config: CollectConfig, threads: int, folder: Path) -> None:
    """Begin a dataset, and stop as the second shard begins."""
    left = [config.lanes * config.steps]

    def advance(count: int) -> None:
        left[0] -= count
        if left[0] < 0:
            raise _Enough

    with suppress(_Enough):
        collect(scenario, config, folder, threads, advance)


def record(scenario: Scenario, config: CollectConfig, threads: int, begun: Path) -> Recorded:
    """Collect the second shard and note what drives it while all copies step: bare steps then do the same physics."""
    simulate, made, driven = scenario.simulate, [], []
    everyone = [True]

    def watched(*arguments: Any) -> Any:
        world: Any = simulate(*arguments)
        simulation, step = world.simulation, world.simulation.step
        moved = simulation.batch.bind("mocap_pos")
        made.append((simulation, simulation.qpos.copy(), simulation.qvel.copy()))

        def noting(ids: np.ndarray, count: int = 1) -> None:
            everyone[0] &= len(ids) == config.lanes
            if everyone[0]:
                driven.append((simulation.ctrl.copy(), moved.copy()))
            step(ids, count)

        simulation.step = noting
        return world

    scenario.simulate = watched
    try:
        second_shard(scenario, config, threads, begun)
    finally:
        scenario.simulate = simulate
    return Recorded(*made[0], driven)


def second_shard(scenario: Scenario, config: CollectConfig, threads: int, begun: Path) -> float:
    """Simulation steps a second of a whole call that records and writes the second shard of a dataset."""
    with tempfile.TemporaryDirectory() as folder:
        copy = shutil.copytree(begun, Path(folder) / "dataset")
        before = json.loads((copy / PROGRESS).read_text())["shards"][0]["simulation_steps"]
        start = time.perf_counter()
        manifest = collect(scenario, config, copy, threads)
        return (manifest.extra["simulation_steps"] - before) / (time.perf_counter() - start)


def collect_vs_raw(scenario: Scenario, lanes: int, steps: int, threads: int, rounds: int = 5) -> Rates:
    """Simulation steps a second of `collect` (phase 2, everything included) over those of bare steps, in turns.

    It is a shard whose obstacles stay where they are, as 7 of 8 do; drawing them costs less than 2 % at 50 steps.
    """
    config = CollectConfig(phase=2, trajectories=2 * lanes, lanes=lanes, steps=steps)
    with tempfile.TemporaryDirectory() as folder:
        begun = Path(folder) / "begun"
        _first_shard(scenario, config, threads, begun)
        recorded = record(scenario, config, threads, begun)
        pairs = [(second_shard(scenario, config, threads, begun), recorded.bare_rate()) for _ in range(rounds)]
    return Rates.of(pairs)
