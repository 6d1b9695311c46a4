"""Many simulations of one model, stepped together; a simulation that diverges is found and named, never data."""

# pyright: reportAttributeAccessIssue=false
# MuJoCo ships no type stubs.

from __future__ import annotations

from abc import abstractmethod
from typing import final

import mujoco
import mujoco.batch
import numpy as np
from jaxtyping import Bool, Float, Int

from fairlead.core.errors import FairleadError
from fairlead.core.records import Executed
from fairlead.core.roles import World

SPEED_LIMIT = 100.0
"""A joint velocity [m/s or rad/s] that no sound simulation reaches."""


class SimulatedWorld(World):
    """A world in a simulator: its copies need not wait for each other, and it knows how well it could lay the rope."""

    @abstractmethod
    def send(self, ids: Int[np.ndarray, " some"], actions: Float[np.ndarray, "some action"]) -> None:
        """Give each of these copies, all of them at rest, its next action."""

    @abstractmethod
    def receive(self) -> tuple[Int[np.ndarray, " some"], Executed]:
        """Simulate until at least one copy is at rest after its action; those copies, in order, and what happened.

        Raises:
            FairleadError: no copy has an action that was sent and not yet received.
        """

    @final
    @staticmethod
    def check_sent(count: int) -> None:
        """Refuse to wait for nothing."""
        if not count:
            raise FairleadError("no copy of the world has an action to carry out: send some first")

    @final
    def execute(self, actions: Float[np.ndarray, "batch action"]) -> Executed:
        everyone = np.arange(len(actions), dtype=np.int32)
        self.send(everyone, actions)
        states, seconds, outcomes = self.observe(), np.zeros(len(actions)), np.zeros(len(actions), int)
        left = len(actions)
        while left:
            ids, done = self.receive()
            states[ids], seconds[ids], outcomes[ids] = done.states, done.seconds, done.outcomes
            left -= len(ids)
        return Executed(states, seconds, outcomes)

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
        self.ctrl = self.batch.bind("ctrl")
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
