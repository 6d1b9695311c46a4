"""The simulated arena: floor, walls, movable boxes, a planar rope and the force-limited gripper that drags it."""

# pyright: reportAttributeAccessIssue=false
# MuJoCo ships no type stubs.

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import final

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome, Executed
from fairlead.geometry.shapes import Box, Obstacle
from fairlead.scenarios.obstacles import Sizes, add_boxes, box_poses, box_sizes
from fairlead.scenarios.rope import FLOOR_BIT, OBSTACLE_BIT, PlanarRope
from fairlead.scenarios.simulate import SimulatedWorld, Simulation, base_options

LAYOUT = StateLayout(("gripper",), 10)
_OUTCOMES = tuple(ActionOutcome)
ARENA = 2.0
WALLS = tuple(
    Box((0.1, ARENA + 0.1, 0.3) if side[0] else (ARENA + 0.1, 0.1, 0.3), (side[0], side[1], 0.15))
    for side in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
)


@dataclass(frozen=True)
class Gripper:
    """A force-limited sphere that follows a set-point.

    f = clip(kp (x_set - x) + kv (v_set - v), force): the clip is on the length of the vector. The set-point moves at
    constant `speed` [m/s] and brakes at `braking` [m/s^2], gentler than friction brakes the rope (mu g), so that the
    rope does not run into its own gripper; it comes to rest within `timeout` [s].
    """

    radius: float = 0.02
    mass: float = 0.2
    force: float = 2.0
    speed: float = 0.17
    braking: float = 0.9
    kp: float = 400.0
    kv: float = 25.0
    tolerance: float = 0.005
    timeout: float = 1.0
    settle: float = 0.2

    def profile(
        self, length: Float[np.ndarray, "batch 1"], time: float
    ) -> tuple[Float[np.ndarray, "batch 1"], Float[np.ndarray, "batch 1"]]:
        """How far [m] and how fast [m/s] the set-point is, `time` seconds after leaving for a target `length` away.

        With v = min(speed, sqrt(2 a l)) and T = (l - v^2 / 2a) / v + v / a:
        v t while cruising, l - a (T - t)^2 / 2 while braking; l is cut to what can be done before the timeout.
        """
        a = self.braking
        length = np.minimum(length, self.speed * self.timeout - self.speed**2 / (2 * a))
        cruise = np.minimum(self.speed, np.sqrt(2 * a * length)) + 1e-12
        left = np.maximum((length - cruise**2 / (2 * a)) / cruise + cruise / a - time, 0.0)
        braking = left < cruise / a
        return np.where(braking, length - a * left**2 / 2, cruise * time), np.where(braking, a * left, cruise)


@lru_cache(maxsize=16)
def build_model(sizes: Sizes | None, rope: PlanarRope, gripper: Gripper) -> mujoco.MjModel:
    """The compiled model, kept for the next world with boxes of the same sizes."""
    return build_spec(sizes, rope, gripper).compile()


def build_spec(sizes: Sizes | None, rope: PlanarRope, gripper: Gripper) -> mujoco.MjSpec:
    """Floor, rope and gripper; walls and one movable box for each of `sizes`, unless that is None: nothing to touch."""
    spec = mujoco.MjSpec()
    spec.modelname = "dragging"
    base_options(spec)
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[2, 2, 0.1],
                            contype=FLOOR_BIT, conaffinity=0, friction=[rope.friction, 0, 0])  # fmt: skip
    for i, wall in enumerate(WALLS if sizes is not None else ()):
        spec.worldbody.add_geom(name=f"wall{i}", type=mujoco.mjtGeom.mjGEOM_BOX, size=np.array(wall.size) / 2,
                                pos=wall.position, contype=OBSTACLE_BIT, conaffinity=0,
                                friction=[rope.friction, 0, 0])  # fmt: skip
    add_boxes(spec, sizes or (), rope.friction)
    body = spec.worldbody.add_body(name="gripper", pos=[0, 0, rope.height])
    for axis, direction in (("x", [1, 0, 0]), ("y", [0, 1, 0])):
        body.add_joint(name=f"gripper_{axis}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=direction)
        motor = spec.add_actuator(name=f"force_{axis}", target=f"gripper_{axis}",
                                  trntype=mujoco.mjtTrn.mjTRN_JOINT)  # fmt: skip
        motor.gainprm[0] = 1.0
    body.add_geom(name="gripper", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[gripper.radius, 0, 0], mass=gripper.mass,
                  contype=0, conaffinity=OBSTACLE_BIT, friction=[rope.friction, 0, 0])  # fmt: skip
    rope.add_to(body)
    return spec


@final
class DraggingWorld(SimulatedWorld):
    """Copies of the arena, one for each row of `states`, settled at the start.

    `obstacles` None is the unconstrained world of phase 1: a floor without obstacles or walls.

    Raises:
        FairleadError: rows with boxes of different sizes.
    """

    def __init__(
        self,
        obstacles: Sequence[Sequence[Obstacle]] | None,
        states: Float[np.ndarray, "batch state"],
        threads: int,
        rope: PlanarRope,
        gripper: Gripper,
    ) -> None:
        sizes = None if obstacles is None else box_sizes(obstacles[0])
        model = build_model(sizes, rope, gripper)
        self.rope, self.gripper, self.simulation = rope, gripper, Simulation(model, len(states), threads)
        batch = self.simulation.batch
        if obstacles is not None and sizes:
            batch.mocap_pos, batch.mocap_quat = box_poses(obstacles, sizes)
        self._hinges = np.array([model.joint(f"hinge{i}").qposadr[0] for i in reversed(range(rope.links))])
        self._all = np.arange(len(states), dtype=np.int32)
        self.place(states)
        self._residual = self._rms(states)

    def place(self, states: Float[np.ndarray, "batch state"]) -> None:
        """Lay every rope at the given points, at rest, and let it settle.

        Where that diverges the rope stays as laid, and the next action ends as diverged.
        """
        qpos = np.zeros_like(self.simulation.qpos)
        qpos[:, :2] = states[:, :2]
        headings = self.rope.headings(states[:, :3], LAYOUT.points_of(states))
        qpos[:, self._hinges] = self.rope.joint_angles(headings)
        self.simulation.qpos[:], self.simulation.qvel[:] = qpos, 0.0
        self._unsound = self._settle(self._all, qpos[:, :2])
        self.simulation.qpos[self._unsound] = qpos[self._unsound]

    @property
    def layout(self) -> StateLayout:
        return LAYOUT

    @property
    def residual(self) -> Float[np.ndarray, " batch"]:
        return self._residual

    @property
    def steps(self) -> int:
        return self.simulation.steps

    def _rms(self, states: Float[np.ndarray, "batch state"]) -> Float[np.ndarray, " batch"]:
        gap = LAYOUT.points_of(self.observe()) - LAYOUT.points_of(states)
        return np.sqrt((gap[..., :2] ** 2).sum(-1).mean(-1))

    def observe(self) -> Float[np.ndarray, "batch state"]:
        """Gripper and link centres [m], by forward kinematics from the joint positions."""
        qpos, rope = self.simulation.qpos, self.rope
        heading = np.cumsum(qpos[:, self._hinges], axis=1)[:, ::-1]
        direction = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
        state = np.full((len(qpos), LAYOUT.state_size), rope.height)
        state[:, :2] = qpos[:, :2]
        LAYOUT.points_of(state)[..., :2] = qpos[:, None, :2] + np.einsum("ij,bjk->bik", rope.centre_weights, direction)
        return state

    def execute(self, actions: Float[np.ndarray, "batch action"]) -> Executed:
        """Move each gripper towards its target until it is there or the time is out, then let the rope settle."""
        before = self.simulation.qpos.copy()
        seconds, outcomes, hold = self._move(actions[:, :2])
        bad = self._unsound | (outcomes == _OUTCOMES.index(ActionOutcome.DIVERGED))
        bad |= self._settle(self._all, hold)
        if bad.any():
            outcomes[bad] = _OUTCOMES.index(ActionOutcome.DIVERGED)
            self.simulation.qpos[bad], self.simulation.qvel[bad] = before[bad], 0.0
        return Executed(self.observe(), seconds + self.gripper.settle, outcomes)

    def _move(
        self, targets: Float[np.ndarray, "batch 2"]
    ) -> tuple[Float[np.ndarray, " batch"], Int[np.ndarray, " batch"], Float[np.ndarray, "batch 2"]]:
        """Returns the seconds taken, the outcomes, and where to hold each gripper while the rope settles."""
        simulation, gripper = self.simulation, self.gripper
        steps = round(gripper.timeout / simulation.dt)
        taken = np.full(len(targets), steps)
        outcomes = np.full(len(targets), _OUTCOMES.index(ActionOutcome.TIMEOUT))
        hold = targets.copy()
        start, active = simulation.qpos[:, :2].copy(), self._all
        for k in range(1, steps + 1):
            self._drive(active, start[active], targets[active], k * simulation.dt)
            simulation.step(active)
            gap = targets[active] - simulation.qpos[active, :2]
            at_rest = np.abs(simulation.qvel[active, :2]).max(1) < gripper.tolerance
            arrived = at_rest & ((gap * gap).sum(1) < gripper.tolerance**2)
            bad = simulation.diverged(active) if k % 5 == 0 else np.zeros(len(active), bool)
            ended = arrived | bad
            if ended.any():
                taken[active[ended]] = k
                outcomes[active[arrived]] = _OUTCOMES.index(ActionOutcome.TARGET)
                outcomes[active[bad]] = _OUTCOMES.index(ActionOutcome.DIVERGED)
                active = active[~ended]
                if not len(active):
                    break
        hold[active] = simulation.qpos[active, :2]
        return taken * simulation.dt, outcomes, hold

    def _drive(
        self, ids: Int[np.ndarray, " active"], start: Float[np.ndarray, "active 2"],
        target: Float[np.ndarray, "active 2"], time: float,
    ) -> None:  # fmt: skip
        """Set the gripper forces for a set-point that left `start` `time` seconds ago."""
        gripper, way = self.gripper, target - start
        length = np.sqrt((way * way).sum(1, keepdims=True)) + 1e-12
        travelled, speed = gripper.profile(length, time)
        direction = way / length
        setpoint, velocity = start + travelled * direction, speed * direction
        force = gripper.kp * (setpoint - self.simulation.qpos[ids, :2]) + gripper.kv * (
            velocity - self.simulation.qvel[ids, :2]
        )
        size = np.sqrt((force * force).sum(1, keepdims=True))
        self.simulation.ctrl[ids] = force * np.minimum(1.0, gripper.force / (size + 1e-12))

    def _settle(
        self, ids: Int[np.ndarray, " active"], hold: Float[np.ndarray, "active 2"]
    ) -> Bool[np.ndarray, " active"]:
        """Hold the grippers until the rope rests; drop what is left of its velocity. Returns which have diverged."""
        for _ in range(round(self.gripper.settle / self.simulation.dt)):
            self._drive(ids, hold, hold, 1.0)
            self.simulation.step(ids)
        diverged = self.simulation.diverged(ids)
        self.simulation.qvel[ids] = 0.0
        return diverged
