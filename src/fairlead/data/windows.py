"""What is recorded without a break in one process: some lanes, until the obstacles move next."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from fairlead.core.streams import stream
from fairlead.core.workers import Tell
from fairlead.data.lanes import Lanes, Recorded
from fairlead.data.store import Obstacles
from fairlead.scenarios.scenario import Scenario


@dataclass(frozen=True)
class Window:
    """Some lanes, and where each begins.

    Args:
        first: number of the first trajectory of every lane.
        lanes: their numbers.
        counts: how many trajectories each records.
        states: in which each begins.
        scenes: what surrounds each; None where something new is arranged first.
    """

    first: int
    lanes: Int[np.ndarray, " lane"]
    counts: Int[np.ndarray, " lane"]
    states: Float[np.ndarray, "lane state"]
    scenes: list[Obstacles | None]


@dataclass(frozen=True)
class Part:
    """The same trajectory number of every lane of a window, and how many simulation steps were taken since the last."""

    recorded: Recorded
    simulation_steps: int


Answer = list[Obstacles] | int | Part
"""What a window tells: first, if any, the scenes that were arranged; how many more actions there are; a part."""


@dataclass(frozen=True)
class Recorder:
    """Records windows of lanes. Streams are named by lane and trajectory: other lanes do not change a byte."""

    scenario: Scenario
    phase: int
    seed: int
    steps: int
    threads: int

    def record(self, window: Window, tell: Tell) -> None:
        """Record a window, and tell of it (see `Answer`)."""
        states, scenes, first = window.states.copy(), list(window.scenes), window.first
        moved = [i for i, scene in enumerate(scenes) if scene is None]
        if moved:
            rngs = [stream(self.seed, "obstacles", self.phase, int(window.lanes[i]), first) for i in moved]
            arranged, states[moved] = self.scenario.rearrange(states[moved], rngs, self.threads)
            tell(list(arranged))
            for i, scene in zip(moved, arranged, strict=True):
                scenes[i] = scene
        if self.phase == 1:
            world = self.scenario.simulate_unconstrained(states, self.threads)
            sampler = self.scenario.unconstrained_sampler
        else:
            world = self.scenario.simulate([scene or () for scene in scenes], states, self.threads)
            sampler = self.scenario.sampler

        def draws(lane: int, number: int) -> np.random.Generator:
            return stream(self.seed, "actions", self.phase, int(window.lanes[lane]), first + number)

        taken = 0
        for recorded in Lanes(world, sampler, window.counts, self.steps, draws, tell).record():
            tell(Part(recorded, world.steps - taken))
            taken = world.steps


def serve(recorder: Recorder) -> Callable[[Window, Tell], None]:
    """What a process does that records windows."""
    return recorder.record
