"""Copies of a world that record trajectories side by side, and do not wait for each other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from fairlead.core.records import ActionOutcome
from fairlead.geometry.motion import RandomDisplacement
from fairlead.scenarios.simulate import SimulatedWorld

_REACHED, _DIVERGED = ActionOutcome.TARGET.number, ActionOutcome.DIVERGED.number
TOGETHER = 8
"""Lanes at rest go on once one of so many is: to begin several actions costs hardly more than to begin one."""


@dataclass(frozen=True)
class Recorded:
    """A trajectory of each lane in `lane`; `sound` where nothing diverged. States and actions in metres."""

    lane: Int[np.ndarray, " lane"]
    sound: Bool[np.ndarray, " lane"]
    states: Float[np.ndarray, "lane steps_and_one state"]
    actions: Float[np.ndarray, "lane steps action"]
    seconds: Float[np.ndarray, "lane steps"]
    outcomes: Int[np.ndarray, "lane steps"]


@final
class Lanes:
    """Records trajectories number 0, 1, ... of every lane.

    A lane begins its next trajectory as soon as it has finished one, from the state it recorded, rounded as recorded.
    So a trajectory depends on that state and its random stream alone, wherever the other lanes are.

    The displacement repeats with the sampler's probability, but never after an action that was blocked: repeating it
    would be blocked again, which teaches little.

    Args:
        world: a copy for each lane, at rest where its first trajectory begins.
        sampler: of the actions.
        counts: how many trajectories each lane records.
        steps: actions in a trajectory.
        stream: the random stream of the actions of a lane in a trajectory.
        advance: told how many more actions there are, those included that lanes ran ahead with for nothing.
    """

    def __init__(
        self,
        world: SimulatedWorld,
        sampler: RandomDisplacement,
        counts: Int[np.ndarray, " lane"],
        steps: int,
        stream: Callable[[int, int], np.random.Generator],
        advance: Callable[[int], None],
    ) -> None:
        self._world, self._sampler, self._counts, self._steps = world, sampler, counts, steps
        self._stream, self._advance = stream, advance
        layout, lanes, shape = world.layout, len(counts), (max(counts), len(counts), steps + 1)
        # Entry k along the last axis is state k, the action taken there, and how state k came about.
        self._states, self._actions = np.empty((*shape, layout.state_size)), np.empty((*shape, layout.action_size))
        self._seconds, self._outcomes = np.zeros(shape), np.full(shape, _REACHED)
        self._finished, self._taken = np.zeros((2, lanes), int)
        self._going, self._keep = np.ones(lanes, bool), np.zeros(lanes, bool)
        self._displacement = np.zeros((lanes, len(layout.grippers), 3))
        self._streams = [stream(lane, 0) for lane in range(lanes)]
        self._states[0, :, 0] = world.observe()

    def record(self) -> Iterator[Recorded]:
        """Each trajectory number once all lanes have finished it; none after one in which a lane diverged."""
        resting = np.arange(len(self._counts))
        for number in range(len(self._states)):
            while (self._going & (self._finished <= number)).any():
                self._begin(resting)
                resting = self._wait()
            lane = np.flatnonzero(self._counts > number)
            sound, columns = self._sound(number, lane), (self._states, self._actions, self._seconds, self._outcomes)
            states, actions, seconds, outcomes = (column[number, lane] for column in columns)
            yield Recorded(lane, sound, states, actions[:, :-1], seconds[:, 1:], outcomes[:, 1:])
            if not sound.all():
                return

    def _begin(self, ids: Int[np.ndarray, " some"]) -> None:
        """Lanes at rest take their next action, or are laid anew where they have finished a trajectory."""
        over = self._taken[ids] == self._steps
        onward, acting = ids[over], ids[~over]
        if len(onward):
            last = self._states[self._finished[onward] - 1, onward, -1]
            self._world.restart(onward, last.astype(np.float32).astype(float))
            self._taken[onward] = -1
            for lane in onward:
                self._streams[lane] = self._stream(int(lane), int(self._finished[lane]))
        if len(acting):
            for i in acting:
                drawn = self._sampler.redraw(self._displacement[[i]], self._keep[[i]], self._streams[i])
                self._displacement[i] = drawn[0]
            at = self._finished[acting], acting, self._taken[acting]
            self._actions[at] = self._sampler.targets(self._states[at], self._displacement[acting])
            self._world.send(acting, self._actions[at])

    def _wait(self) -> Int[np.ndarray, " some"]:
        """Note what happens until enough of the lanes that go on are at rest; those lanes."""
        resting = np.empty(0, int)
        while (wanted := -(-int(self._going.sum()) // TOGETHER) - len(resting)) > 0:
            ids, done = self._world.receive(wanted)
            self._taken[ids] += 1
            at = self._finished[ids], ids, self._taken[ids]
            self._states[at], self._seconds[at], self._outcomes[at] = done.states, done.seconds, done.outcomes
            acted, over = self._taken[ids] > 0, ids[self._taken[ids] == self._steps]
            self._keep[ids] = acted & (done.outcomes == _REACHED)
            sound = self._sound(self._finished[over], over)
            self._finished[over] += 1
            self._going[over] = sound & (self._finished[over] < self._counts[over])
            resting = np.concatenate([resting, ids[self._going[ids]]])
            self._advance(int(acted.sum()))
        return np.sort(resting)

    def _sound(
        self, number: int | Int[np.ndarray, " some"], ids: Int[np.ndarray, " some"]
    ) -> Bool[np.ndarray, " some"]:
        """Whether nothing diverged in a finished trajectory."""
        finite = np.isfinite(self._states[number, ids]).all(axis=(1, 2))
        return np.asarray(finite & (self._outcomes[number, ids] != _DIVERGED).all(axis=1))
