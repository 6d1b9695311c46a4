"""Many simulations of one model, stepped together; a simulation that diverges is found and named, never data."""

# pyright: reportAttributeAccessIssue=false
# MuJoCo ships no type stubs.

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import fields
from typing import final

import mujoco
import mujoco.batch
import numpy as np
from jaxtyping import Bool, Float, Int

from fairlead.core.errors import FairleadError
from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome, Executed
from fairlead.core.roles import World

_DIVERGED = ActionOutcome.DIVERGED.number
SPEED_LIMIT = 100.0
"""A joint velocity [m/s or rad/s] that no sound simulation reaches."""


class SimulatedWorld(World):
    """A world in a simulator: its copies need not wait for each other, and it knows how well it could lay the rope."""

    @abstractmethod
    def send(self, ids: Int[np.ndarray, " some"], actions: Float[np.ndarray, "some action"]) -> None:
        """Give each of these copies, all of them at rest, its next action."""

    @abstractmethod
    def restart(self, ids: Int[np.ndarray, " some"], states: Float[np.ndarray, "some state"]) -> None:
        """Put these copies, all of them at rest, into these states, as a new world would; `receive` tells of it too."""

    @abstractmethod
    def receive(self, wanted: int = 1) -> tuple[Int[np.ndarray, " some"], Executed]:
        """Simulate until so many copies, or all that act, are at rest; those copies, in order, and what happened.

        A world may tell of fewer, at least one: to wait for several only saves time.

        Raises:
            FairleadError: no copy has an action that was sent and not yet received.
        """

    @final
    def execute(self, actions: Float[np.ndarray, "batch action"]) -> Executed:
        return self.carry(np.arange(len(actions)), actions)

    @final
    def carry(self, ids: Int[np.ndarray, " some"], actions: Float[np.ndarray, "some action"]) -> Executed:
        """One action of some copies, given in order; the others rest."""
        self.send(ids, actions)
        return self.receive_all(len(ids))

    @final
    def receive_all(self, count: int) -> Executed:
        """What happened to `count` copies, all that something was sent to, in their order."""
        parts: list[tuple[np.ndarray, Executed]] = []
        while sum(len(ids) for ids, _ in parts) < count:
            parts.append(self.receive(count - sum(len(ids) for ids, _ in parts)))
        order = np.argsort(np.concatenate([ids for ids, _ in parts]))
        columns = [np.concatenate([getattr(done, field.name) for _, done in parts]) for field in fields(Executed)]
        return Executed(*(column[order] for column in columns))

    @property
    @abstractmethod
    def residual(self) -> Float[np.ndarray, " batch"]:
        """Root-mean-square distance [m] between the given rope points and the settled ones, for each copy.

        Infinite where settling diverged: such a start cannot be simulated.
        """

    @property
    @abstractmethod
    def steps(self) -> int:
        """Simulation steps taken so far, over all copies."""


def base_options(spec: mujoco.MjSpec, timestep: float = 0.004) -> None:
    """Solver settings shared by the scenarios; see docs/adr/0001 for what was measured."""
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    spec.compiler.degree = False


@final
class Simulation:
    """`count` copies of a model on `threads` threads; the same numbers at any number of threads."""

    def __init__(self, model: mujoco.MjModel, count: int, threads: int) -> None:
        self.model = model
        self.batch = mujoco.batch.Batch(model, count, threads)
        self.dt: float = model.opt.timestep
        self.qpos, self.qvel = self.batch.bind("qpos"), self.batch.bind("qvel")
        self.ctrl, self.mocap = self.batch.bind("ctrl"), self.batch.bind("mocap_pos")
        self.warmstart = self.batch.bind("qacc_warmstart")
        self.steps = 0

    def step(self, ids: Int[np.ndarray, " active"], count: int = 1) -> None:
        """Advance some simulations by `count` steps."""
        self.batch.step(ids, count)
        self.steps += len(ids) * count

    def diverged(self, ids: Int[np.ndarray, " active"]) -> Bool[np.ndarray, " active"]:
        """Which of these simulations have left what is physical: not finite, or impossibly fast."""
        velocity = self.qvel[ids]
        sound = np.isfinite(self.qpos[ids]).all(axis=1) & (np.abs(velocity) < SPEED_LIMIT).all(axis=1)
        return np.asarray(~sound)


class PhysicalWorld(SimulatedWorld):
    """Copies of a model. A subclass says how they begin, what a tick of their clocks does, and when they are at rest.

    Its constructor makes this one's call first, and `_settle` last.

    Args:
        simulation: of the copies.
        layout: how to read a state.
        tick: simulated time [s] between two ticks.
    """

    def __init__(self, simulation: Simulation, layout: StateLayout, tick: float) -> None:
        count = len(simulation.qpos)
        self.simulation, self._layout, self._tick_s = simulation, layout, tick
        self._active, self._unsound = np.empty(0, np.int32), np.zeros(count, bool)
        self._clock, self._outcome = np.zeros((2, count), int)
        self._safe_qpos, self._safe_mocap = simulation.qpos.copy(), simulation.mocap.copy()

    @abstractmethod
    def _lay(self, ids: Int[np.ndarray, " some"], states: Float[np.ndarray, "some state"]) -> None:
        """Put these ropes along the given points, where ticks will let them settle."""

    @abstractmethod
    def _begin(self, ids: Int[np.ndarray, " some"], actions: Float[np.ndarray, "some action"]) -> None:
        """Begin an action."""

    @abstractmethod
    def _tick(self, ids: Int[np.ndarray, " active"]) -> Bool[np.ndarray, " active"]:
        """Simulate up to the next tick; which copies are at rest, their `_outcome` noted."""

    @abstractmethod
    def _observe(self, ids: Int[np.ndarray, " some"]) -> Float[np.ndarray, "some state"]:
        """The states of some copies [m]."""

    @property
    @final
    def layout(self) -> StateLayout:
        return self._layout

    @property
    @final
    def residual(self) -> Float[np.ndarray, " batch"]:
        return self._residual

    @property
    @final
    def steps(self) -> int:
        return self.simulation.steps

    @final
    def observe(self) -> Float[np.ndarray, "batch state"]:
        return self._observe(np.arange(len(self._clock), dtype=np.int32))

    @final
    def _settle(self, states: Float[np.ndarray, "batch state"]) -> None:
        """Lay every rope and let it settle. Where that diverges it stays as laid, and every action ends as diverged."""
        self.restart(np.arange(len(states)), states)
        settled = self.receive_all(len(states))
        self._unsound = settled.diverged
        gap = self._layout.points_of(settled.states) - self._layout.points_of(states)
        self._residual = np.where(self._unsound, np.inf, np.sqrt((gap * gap).sum(-1).mean(-1)))

    @final
    def restart(self, ids: Int[np.ndarray, " some"], states: Float[np.ndarray, "some state"]) -> None:
        self.simulation.warmstart[ids], self._unsound[ids] = 0.0, False
        self._start(self._lay, ids, states)

    @final
    def send(self, ids: Int[np.ndarray, " some"], actions: Float[np.ndarray, "some action"]) -> None:
        self._start(self._begin, ids, actions)

    def _start(self, begin: Callable[[np.ndarray, np.ndarray], None], ids: np.ndarray, given: np.ndarray) -> None:
        self._clock[ids] = 0
        begin(ids, given)
        self._safe_qpos[ids], self._safe_mocap[ids] = self.simulation.qpos[ids], self.simulation.mocap[ids]
        self._active = np.union1d(self._active, ids).astype(np.int32)

    @final
    def receive(self, wanted: int = 1) -> tuple[Int[np.ndarray, " some"], Executed]:
        if not len(self._active):
            raise FairleadError("no copy of the world has an action to carry out: send some first")
        left, rested = max(len(self._active) - wanted, 0), []
        while len(self._active) > left:
            self._clock[self._active] += 1
            at_rest = self._tick(self._active)
            if at_rest.any():
                rested.append(self._active[at_rest])
                self._active = self._active[~at_rest]
        ids, simulation = np.sort(np.concatenate(rested)), self.simulation
        lost = ids[self._unsound[ids] | simulation.diverged(ids) | (self._outcome[ids] == _DIVERGED)]
        self._outcome[lost] = _DIVERGED
        simulation.qpos[lost], simulation.mocap[lost] = self._safe_qpos[lost], self._safe_mocap[lost]
        simulation.qvel[ids], simulation.warmstart[lost] = 0.0, 0.0
        return ids, Executed(self._observe(ids), self._clock[ids] * self._tick_s, self._outcome[ids])
