"""Collection (paper, "Data collection"): lanes of trajectories side by side, with no reset in between.

Shard k is trajectory number k of every lane. It is a function of the seed and of shard k - 1 as recorded, so a run
that was killed and started again writes the same bytes as one that was not, at any number of threads.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from fairlead.core.artifacts import Manifest
from fairlead.core.budget import Clock
from fairlead.core.errors import FairleadError
from fairlead.core.records import ActionOutcome
from fairlead.core.streams import stream
from fairlead.data.recording import Recording
from fairlead.data.shards import Shard, split_of
from fairlead.data.store import Obstacles
from fairlead.scenarios.scenario import Scenario
from fairlead.scenarios.simulate import SimulatedWorld

_REACHED, _DIVERGED = map(tuple(ActionOutcome).index, (ActionOutcome.TARGET, ActionOutcome.DIVERGED))


@dataclass(frozen=True)
class CollectConfig:
    """What to record. With the scenario, this decides every byte.

    Args:
        phase: 1, without obstacles, for dynamics; 2, among obstacles, for trust and recovery.
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
        advance: told how many more transitions there are, those found at the start included.
        clock: measures wall time.

    Raises:
        ArtifactError: the folder holds something else.
    """
    resolved = config.resolved(scenario)
    lanes, steps = resolved["lanes"], resolved["steps"]
    recording = Recording(folder, resolved)
    if recording.manifest:
        return recording.manifest
    previous = recording.last()
    advance(min(len(recording) * lanes, config.trajectories) * steps)
    for index in range(len(recording), -(-config.trajectories // lanes)):
        began, count = clock(), min(lanes, config.trajectories - index * lanes)
        starts = _starts(scenario, config, index, count, previous, recording.scenes, threads)
        if config.phase == 1:
            world = scenario.simulate_unconstrained(starts.states, threads)
        else:
            world = scenario.simulate([starts.scenes[i] for i in starts.scene], starts.states, threads)
        previous, diverged = _record(scenario, config.seed, index, starts.scene, world, resolved, advance)
        new = starts.scenes[len(recording.scenes) :]
        recording.append(previous, new, diverged=diverged, simulation_steps=world.steps, wall_s=clock() - began)
    return recording.finish()


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


def _record(
    scenario: Scenario,
    seed: int,
    index: int,
    scene: Int[np.ndarray, " lane"],
    world: SimulatedWorld,
    config: Mapping[str, Any],
    advance: Callable[[int], None],
) -> tuple[Shard, int]:
    """One trajectory of every lane, and how many diverged and are left out.

    The displacement repeats with the sampler's probability, but never after an action that was blocked: repeating it
    would be blocked again, which teaches little.
    """
    sampler = scenario.unconstrained_sampler if config["phase"] == 1 else scenario.sampler
    lanes, steps, layout = np.arange(len(scene)), config["steps"], scenario.layout
    streams = [stream(seed, "actions", config["phase"], int(lane), index) for lane in lanes]
    displacement = np.zeros((len(lanes), len(layout.grippers), 3))
    keep = np.zeros(len(lanes), bool)
    states = np.empty((len(lanes), steps + 1, layout.state_size))
    actions = np.empty((len(lanes), steps, layout.action_size))
    seconds, outcomes = np.empty((len(lanes), steps)), np.empty((len(lanes), steps), int)
    states[:, 0] = world.observe()
    taken, ready = np.zeros(len(lanes), int), lanes
    while (taken < steps).any():
        ready = ready[taken[ready] < steps]
        for i in ready:
            displacement[i] = sampler.redraw(displacement[i : i + 1], keep[i : i + 1], streams[i])[0]
        at = ready, taken[ready]
        actions[at] = sampler.targets(states[at], displacement[ready])
        world.send(ready, actions[at])
        ready, done = world.receive()
        seconds[ready, taken[ready]], outcomes[ready, taken[ready]] = done.seconds, done.outcomes
        taken[ready] += 1
        states[ready, taken[ready]], keep[ready] = done.states, done.outcomes == _REACHED
        advance(len(ready))
    sound = np.isfinite(states).all(axis=(1, 2)) & (outcomes != _DIVERGED).all(axis=1)
    shard = Shard(
        episode=(index * config["lanes"] + lanes)[sound],
        lane=lanes[sound],
        scene=scene[sound],
        split=np.array([split_of(int(lane)) for lane in lanes[sound]], dtype=str),
        states=states[sound].astype(np.float32),
        actions=actions[sound].astype(np.float32),
        seconds=seconds[sound].astype(np.float32),
        outcomes=outcomes[sound],
    )
    return shard, int((~sound).sum())
