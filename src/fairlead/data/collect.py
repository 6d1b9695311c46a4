"""Collection (paper, "Data collection"): lanes of trajectories side by side, with no reset in between.

Shard k is trajectory number k of every lane. It is a function of the seed and of shard k - 1 as recorded, so a run
that was killed and started again writes the same bytes as one that was not, at any number of threads. Lanes wait for
each other only where the obstacles move.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from fairlead.core.artifacts import Manifest
from fairlead.core.budget import Clock
from fairlead.core.errors import FairleadError
from fairlead.core.streams import stream
from fairlead.data.lanes import Lanes, Recorded
from fairlead.data.recording import Recording
from fairlead.data.shards import Shard, split_of
from fairlead.data.store import Obstacles
from fairlead.scenarios.scenario import Scenario


@dataclass(frozen=True)
class CollectConfig:
    """What to record. With the scenario, this decides every byte.

    Args:
        phase: 1, without obstacles, for dynamics; 2, among obstacles, for the others.
        trajectories: how many; those that diverge are dropped.
        seed: of every random stream.
        lanes: chains of trajectories that run side by side.
        steps: actions in a trajectory; 0 for the paper's.
        obstacles_every: obstacles move after this many trajectories of a lane.
    """

    phase: int
    trajectories: int
    seed: int = 0
    lanes: int = 64
    steps: int = 0
    obstacles_every: int = 8

    def __post_init__(self) -> None:
        if self.phase not in (1, 2):
            raise FairleadError(f"phase {self.phase}: 1 (no obstacles) or 2 (obstacles) is needed")
        for name in ("trajectories", "lanes", "obstacles_every"):
            if getattr(self, name) < 1:
                raise FairleadError(f"{name} {getattr(self, name)}: at least 1 is needed")
        if self.steps < 0:
            raise FairleadError(f"steps {self.steps}: at least 1 is needed, or 0 for the paper's")

    def resolved(self, scenario: Scenario) -> dict[str, Any]:
        """Every value that the data depend on."""
        return {
            **asdict(self),
            "scenario": scenario.name,
            "grippers": list(scenario.layout.grippers),
            "points": scenario.layout.points,
            "lanes": min(self.lanes, self.trajectories),
            "steps": self.steps or scenario.paper_data[self.phase - 1][1],
        }


def collect(
    scenario: Scenario,
    config: CollectConfig,
    folder: Path,
    threads: int = 1,
    advance: Callable[[int], None] = lambda _: None,
    clock: Clock = time.perf_counter,
) -> Manifest:
    """Record a dataset, or finish one that was interrupted.

    Args:
        scenario: the world.
        config: what to record.
        folder: where; a finished dataset of the same configuration is verified and left as it is.
        threads: of the simulator; they do not change a byte.
        advance: told how many more transitions there are, those found at the start included; fewer, where some were
            dropped.
        clock: measures wall time.

    Raises:
        ArtifactError: the folder holds something else.
    """
    recording = Recording(folder, config.resolved(scenario))
    if recording.manifest:
        return recording.manifest
    lanes, steps = recording.config["lanes"], recording.config["steps"]
    advance(min(len(recording) * lanes, config.trajectories) * steps)
    while len(recording) * lanes < config.trajectories:
        _record(scenario, config, recording, threads, advance, clock)
    return recording.finish()


def _record(
    scenario: Scenario,
    config: CollectConfig,
    recording: Recording,
    threads: int,
    advance: Callable[[int], None],
    clock: Clock,
) -> None:
    """The shards up to where the obstacles move next, or to one in which a lane diverged.

    Meanwhile lanes run ahead of each other; what a lane has recorded beyond the last shard is lost when the run ends.
    """
    began, taken, first, lanes = clock(), 0, len(recording), recording.config["lanes"]
    lane = np.arange(min(lanes, config.trajectories - first * lanes))
    moves = first - first % config.obstacles_every + config.obstacles_every
    counts = np.minimum(moves, -(-(config.trajectories - lane) // lanes)) - first
    starts = _starts(scenario, config, first, len(lane), recording.last(), recording.scenes, threads)
    if config.phase == 1:
        world, sampler = scenario.simulate_unconstrained(starts.states, threads), scenario.unconstrained_sampler
    else:
        obstacles = [starts.scenes[i] for i in starts.scene]
        world, sampler = scenario.simulate(obstacles, starts.states, threads), scenario.sampler

    def draws(lane: int, number: int) -> np.random.Generator:
        return stream(config.seed, "actions", config.phase, lane, first + number)

    for recorded in Lanes(world, sampler, counts, recording.config["steps"], draws, advance).record():
        shard = _shard(len(recording) * lanes, starts.scene, recorded)
        facts = {"diverged": int((~recorded.sound).sum()), "simulation_steps": world.steps - taken}
        recording.append(shard, starts.scenes[len(recording.scenes) :], **facts, wall_s=clock() - began)
        began, taken = clock(), world.steps


@dataclass(frozen=True)
class _Starts:
    """Where the lanes go on: a state each, the index of its scene, and all scenes so far."""

    states: Float[np.ndarray, "lane state"]
    scene: Int[np.ndarray, " lane"]
    scenes: list[Obstacles]


def _starts(
    scenario: Scenario,
    config: CollectConfig,
    index: int,
    count: int,
    previous: Shard | None,
    known: list[Obstacles],
    threads: int,
) -> _Starts:
    """A lane goes on from its last recorded state; a new one, or one that diverged, starts afresh.

    In phase 2 the scenario arranges a new scene for a fresh start and every `obstacles_every` trajectories.
    """
    scenes, states, scene, moved = list(known), [], [], []
    if config.phase == 1 and not scenes:
        scenes.append(())
    rows = () if previous is None else zip(previous.lane, previous.states[:, -1], previous.scene, strict=True)
    ends = {int(lane): (state.astype(float), int(place)) for lane, state, place in rows}
    for lane in range(count):
        fresh = lane not in ends
        start = stream(config.seed, "start", config.phase, lane, index)
        state, place = (scenario.random_start(start), 0) if fresh else ends[lane]
        if config.phase == 2 and (fresh or index % config.obstacles_every == 0):
            place = len(scenes) + len(moved)
            moved.append(lane)
        states.append(state)
        scene.append(place)
    stacked = np.stack(states)
    if moved:
        rngs = [stream(config.seed, "obstacles", config.phase, lane, index) for lane in moved]
        obstacles, stacked[moved] = scenario.rearrange(stacked[moved], rngs, threads)
        scenes.extend(obstacles)
    return _Starts(stacked, np.array(scene), scenes)


def _shard(episode: int, scene: Int[np.ndarray, " lane"], recorded: Recorded) -> Shard:
    """What was recorded and did not diverge; `episode` is the number of the first lane's."""
    lane, sound = recorded.lane[recorded.sound], recorded.sound
    return Shard(
        episode=episode + lane,
        lane=lane,
        scene=scene[lane],
        split=np.array([split_of(int(i)) for i in lane], dtype=str),
        states=recorded.states[sound].astype(np.float32),
        actions=recorded.actions[sound].astype(np.float32),
        seconds=recorded.seconds[sound].astype(np.float32),
        outcomes=recorded.outcomes[sound],
    )
