"""Collection (paper, "Data collection"): lanes of trajectories side by side, with no reset in between.

Shard k is trajectory number k of every lane. It is a function of the seed and of shard k - 1 as recorded, so a run
that was killed and started again writes the same bytes as one that was not, at any number of threads. Lanes wait for
each other only where the obstacles move.
"""

from __future__ import annotations

import itertools
import time
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any, final

import numpy as np
from jaxtyping import Int

from fairlead.core.artifacts import Manifest, alone
from fairlead.core.budget import Clock
from fairlead.core.errors import FairleadError
from fairlead.core.streams import stream
from fairlead.core.workers import Ended, Workers, travels
from fairlead.data.lanes import Recorded
from fairlead.data.recording import Recording
from fairlead.data.shards import Shard, split_of
from fairlead.data.store import Obstacles
from fairlead.data.windows import Answer, Part, Recorder, Window, serve
from fairlead.scenarios.registry import scenario_fingerprint
from fairlead.scenarios.scenario import Scenario

GROUP = 32
"""Lanes that a process is worth: it takes seconds to start, and what is not physics in a step is shared by them."""


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
        version = scenario_fingerprint(scenario.name)
        return {
            **asdict(self),
            "scenario": scenario.name,
            **({} if version is None else {"scenario_sha256": version}),
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
        threads: of the simulator; they do not change a byte. For many lanes they are shared out to several processes,
            if the scenario can be pickled; a script that asks for it does so under `if __name__ == "__main__":`.
        advance: told how many more transitions there are, those found at the start included; fewer, where some were
            dropped.
        clock: measures wall time.

    Raises:
        ArtifactError: the folder holds something else, or another process records into it.
    """
    with alone(folder):
        recording = Recording(folder, config.resolved(scenario))
        if recording.manifest:
            advance(config.trajectories * recording.config["steps"])
            return recording.manifest
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
    """Record all trajectories that are missing."""
    lanes, steps = recording.config["lanes"], recording.config["steps"]
    advance(min(len(recording) * lanes, config.trajectories) * steps)
    groups = max(1, min(threads, lanes // GROUP)) if travels(scenario) else 1
    recorder = Recorder(scenario, config.phase, config.seed, steps, max(1, threads // groups))
    with Workers(serve, recorder, groups) as workers:
        while len(recording) * lanes < config.trajectories:
            windows, places = _windows(scenario, config, recording, groups)
            gathered = _Gathered(recording, windows, places, advance, clock)
            if groups == 1:
                recorder.record(windows[0], partial(gathered.take, 0))
            else:
                for group, window in enumerate(windows):
                    workers.begin(group, window)
                for group, answer in workers.answers():
                    if answer is not Ended.JOB:
                        gathered.take(group, answer)
            gathered.close()


def _windows(
    scenario: Scenario, config: CollectConfig, recording: Recording, groups: int
) -> tuple[list[Window], Int[np.ndarray, " lane"]]:
    """What each group of lanes records until the obstacles move next, and the index of each lane's scene.

    A lane goes on from its last recorded state; a new one, or one that diverged, starts afresh. In phase 2 the scenario
    arranges a new scene for a fresh start and every `obstacles_every` trajectories.
    """
    first, lanes, previous = len(recording), recording.config["lanes"], recording.last()
    rows = () if previous is None else zip(previous.lane, previous.states[:, -1], previous.scene, strict=True)
    ends = {int(lane): (state.astype(float), int(place)) for lane, state, place in rows}
    moves = first - first % config.obstacles_every + config.obstacles_every
    windows, places, new = [], [], itertools.count(len(recording.scenes))
    for ids in np.array_split(np.arange(min(lanes, config.trajectories - first * lanes)), groups):
        states, scenes = [], []
        for lane in map(int, ids):
            fresh = lane not in ends
            start = stream(config.seed, "start", config.phase, lane, first)
            state, place = (scenario.random_start(start), 0) if fresh else ends[lane]
            moved = config.phase == 2 and (fresh or first % config.obstacles_every == 0)
            states.append(state)
            scenes.append(None if moved else recording.scenes[place] if recording.scenes else ())
            places.append(next(new) if moved else place)
        if states:
            counts = np.minimum(moves, -(-(config.trajectories - ids) // lanes)) - first
            windows.append(Window(first, ids, counts, np.stack(states), scenes))
    return windows, np.array(places)


@final
class _Gathered:
    """Puts together, shard by shard, what groups of lanes record side by side.

    The shards go up to where the obstacles move next, or to one in which a lane diverged. Meanwhile lanes run ahead of
    each other, and where one diverged the other groups to their window's end; what a lane has recorded beyond the last
    shard is lost.
    """

    def __init__(
        self,
        recording: Recording,
        windows: list[Window],
        places: Int[np.ndarray, " lane"],
        advance: Callable[[int], None],
        clock: Clock,
    ) -> None:
        self._recording, self._windows, self._places = recording, windows, places
        self._advance, self._clock = advance, clock
        self._arranged: list[list[Obstacles]] = [[] for _ in windows]
        self._parts: list[deque[Part]] = [deque() for _ in windows]
        self._number, self._sound, self._told, self._began = 0, True, 0, clock()

    def take(self, group: int, answer: Answer) -> None:
        """What a group's window told."""
        if isinstance(answer, int):
            self._told += answer
            self._advance(answer)
        elif isinstance(answer, list):
            self._arranged[group] = answer
        else:
            self._parts[group].append(answer)
            while self._sound and (groups := self._recording_groups()) and all(self._parts[i] for i in groups):
                self._append(groups)

    def close(self) -> None:
        """All windows have ended: take back what was told of actions that are in no shard."""
        if self._told:
            self._advance(-self._told)

    def _recording_groups(self) -> list[int]:
        """The groups that record a trajectory of the next number."""
        return [i for i, window in enumerate(self._windows) if window.counts.max() > self._number]

    def _append(self, groups: list[int]) -> None:
        """Write the next shard, the first time with the scenes that were arranged."""
        scenes = [] if self._number else [scene for arranged in self._arranged for scene in arranged]
        if not scenes and not self._recording.scenes:
            scenes = [()]
        parts = [self._parts[i].popleft() for i in groups]
        lane = np.concatenate(
            [self._windows[i].lanes[part.recorded.lane] for i, part in zip(groups, parts, strict=True)]
        )
        columns = {f.name: np.concatenate([getattr(part.recorded, f.name) for part in parts]) for f in fields(Recorded)}
        recorded = Recorded(**columns | {"lane": lane})
        taken, diverged = sum(part.simulation_steps for part in parts), int((~recorded.sound).sum())
        facts = {"diverged": diverged, "simulation_steps": taken}
        shard = _shard(len(self._recording) * self._recording.config["lanes"], self._places[lane], recorded)
        self._recording.append(shard, scenes, **facts, wall_s=self._clock() - self._began)
        self._told -= recorded.outcomes.size
        self._number, self._sound, self._began = self._number + 1, bool(recorded.sound.all()), self._clock()


def _shard(episode: int, place: Int[np.ndarray, " lane"], recorded: Recorded) -> Shard:
    """What was recorded and did not diverge; `episode` is the number of the first lane's."""
    lane, sound = recorded.lane[recorded.sound], recorded.sound
    return Shard(
        episode=episode + lane,
        lane=lane,
        scene=place[sound],
        split=np.array([split_of(int(i)) for i in lane], dtype=str),
        states=recorded.states[sound].astype(np.float32),
        actions=recorded.actions[sound].astype(np.float32),
        seconds=recorded.seconds[sound].astype(np.float32),
        outcomes=recorded.outcomes[sound],
    )
