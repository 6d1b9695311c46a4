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
from fairlead.core.records import ActionOutcome
from fairlead.geometry.shapes import Box, Obstacle
from fairlead.scenarios.obstacles import Sizes, add_boxes, box_sizes, place_boxes
from fairlead.scenarios.rope import FLOOR_BIT, OBSTACLE_BIT, PlanarRope
from fairlead.scenarios.simulate import PhysicalWorld, Simulation, base_options

LAYOUT = StateLayout(("gripper",), 10)
_TARGET, _TIMEOUT, _DIVERGED = (o.number for o in (ActionOutcome.TARGET, ActionOutcome.TIMEOUT, ActionOutcome.DIVERGED))
_NEVER, _CHECK_EVERY = -1, 5
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
        self, length: Float[np.ndarray, "batch 1"], time: Float[np.ndarray, " time"]
    ) -> tuple[Float[np.ndarray, "batch time"], Float[np.ndarray, "batch time"]]:
        """How far [m] and how fast [m/s] the set-point is, `time` [s] after leaving for a target `length` away.

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
class DraggingWorld(PhysicalWorld):
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
        simulation = Simulation(model, len(states), threads)
        super().__init__(simulation, LAYOUT, model.opt.timestep)
        self.rope, self.gripper = rope, gripper
        if obstacles is not None:
            place_boxes(simulation.batch, obstacles)
        self._hinges = np.array([model.joint(f"hinge{i}").qposadr[0] for i in reversed(range(rope.links))])
        self._settle_steps, self._last = (round(s / model.opt.timestep) for s in (gripper.settle, gripper.timeout))
        self._times = np.arange(self._last + self._settle_steps + 1) * model.opt.timestep
        self._ticks, self._rows, self._end = 0, np.arange(len(states)), np.zeros(len(states), int)
        self._to, self._at, self._speed = np.zeros((len(states), 2)), simulation.qpos[:, :2], simulation.qvel[:, :2]
        self._setpoint, self._velocity = np.zeros((2, len(states), len(self._times), 2))
        flat = states.copy()
        flat[:, 2::3] = rope.height
        self._settle(flat)

    def _lay(self, ids: Int[np.ndarray, " some"], states: Float[np.ndarray, "some state"]) -> None:
        headings = self.rope.headings(states[:, :3], LAYOUT.points_of(states))
        qpos = np.zeros((len(ids), self.simulation.model.nq))
        qpos[:, :2], qpos[:, self._hinges] = states[:, :2], self.rope.joint_angles(headings)
        self.simulation.qpos[ids] = qpos
        self._outcome[ids] = _TARGET
        self._hold(ids, states[:, :2])

    def _observe(self, ids: Int[np.ndarray, " some"]) -> Float[np.ndarray, "some state"]:
        """Gripper and link centres [m], by forward kinematics from the joint positions."""
        qpos, rope = self.simulation.qpos[ids], self.rope
        heading = np.cumsum(qpos[:, self._hinges], axis=1)[:, ::-1]
        direction = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
        state = np.full((len(qpos), LAYOUT.state_size), rope.height)
        state[:, :2] = qpos[:, :2]
        LAYOUT.points_of(state)[..., :2] = qpos[:, None, :2] + np.einsum("ij,bjk->bik", rope.centre_weights, direction)
        return state

    def _begin(self, ids: Int[np.ndarray, " some"], actions: Float[np.ndarray, "some action"]) -> None:
        """Look up the set-points of the whole motion now, so that a step finds them by its clock."""
        start = self._at[ids, None]
        way = actions[:, None, :2] - start
        length = np.sqrt((way * way).sum(2)) + 1e-12
        travelled, speed = self.gripper.profile(length, self._times)
        direction = way / length[..., None]
        self._setpoint[ids] = start + travelled[..., None] * direction
        self._velocity[ids] = speed[..., None] * direction
        self._to[ids], self._end[ids] = actions[:, :2], _NEVER

    def _hold(self, ids: Int[np.ndarray, " some"], positions: Float[np.ndarray, "some 2"]) -> None:
        """Stay there until the rope has settled."""
        self._setpoint[ids], self._velocity[ids] = positions[:, None], 0.0
        self._end[ids] = self._clock[ids] + self._settle_steps

    def _tick(self, ids: Int[np.ndarray, " active"]) -> Bool[np.ndarray, " active"]:
        """One step of each copy; those that end their motion hold where they are, or should be.

        Numbers of all copies are looked at, because that is faster than choosing some; nothing comes of those at rest.
        """
        simulation, clock, tolerance = self.simulation, self._clock, self.gripper.tolerance
        self._drive()
        simulation.step(ids)
        moving, gap = self._end == _NEVER, self._to - self._at
        arrived = moving & ((gap * gap).sum(1) < tolerance**2)
        if arrived.any():
            arrived &= np.abs(self._speed).max(1) < tolerance
        late = moving & ~arrived & (clock == self._last)
        bad = np.zeros_like(moving)
        self._ticks += 1
        if self._ticks % _CHECK_EVERY == 0:
            bad[ids] = moving[ids] & simulation.diverged(ids)
        ended = np.flatnonzero(arrived | late | bad)
        if len(ended):
            self._outcome[late], self._outcome[arrived], self._outcome[bad] = _TIMEOUT, _TARGET, _DIVERGED
            self._to[late] = self._at[late]
            self._hold(ended, self._to[ended])
        return np.asarray(clock[ids] == self._end[ids])

    def _drive(self) -> None:
        """Set the gripper forces for the set-points."""
        gripper, now = self.gripper, (self._rows, self._clock)
        force = gripper.kp * (self._setpoint[now] - self._at) + gripper.kv * (self._velocity[now] - self._speed)
        size = np.sqrt((force * force).sum(1, keepdims=True))
        self.simulation.ctrl[:] = force * np.minimum(1.0, gripper.force / (size + 1e-12))
