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
_TARGET, _TIMEOUT, _DIVERGED = map(
    tuple(ActionOutcome).index, (ActionOutcome.TARGET, ActionOutcome.TIMEOUT, ActionOutcome.DIVERGED)
)
_NEVER = -1
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
        self, length: Float[np.ndarray, "batch 1"], time: Float[np.ndarray, "batch 1"]
    ) -> tuple[Float[np.ndarray, "batch 1"], Float[np.ndarray, "batch 1"]]:
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
        super().__init__(Simulation(model, len(states), threads), LAYOUT, model.opt.timestep)
        self.rope, self.gripper = rope, gripper
        if obstacles is not None:
            place_boxes(self.simulation.batch, obstacles)
        self._hinges = np.array([model.joint(f"hinge{i}").qposadr[0] for i in reversed(range(rope.links))])
        self._settle_steps = round(gripper.settle / model.opt.timestep)
        self._from, self._to = np.zeros((2, len(states), 2))
        self._end = np.zeros(len(states), int)
        flat = states.copy()
        flat[:, 2::3] = rope.height
        self._settle(flat)

    def _lay(self, ids: Int[np.ndarray, " some"], states: Float[np.ndarray, "some state"]) -> None:
        headings = self.rope.headings(states[:, :3], LAYOUT.points_of(states))
        qpos = np.zeros((len(ids), self.simulation.model.nq))
        qpos[:, :2], qpos[:, self._hinges] = states[:, :2], self.rope.joint_angles(headings)
        self.simulation.qpos[ids] = qpos
        self._from[ids] = self._to[ids] = states[:, :2]
        self._end[ids], self._outcome[ids] = self._settle_steps, _TARGET

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
        self._from[ids], self._to[ids] = self.simulation.qpos[ids, :2], actions[:, :2]
        self._end[ids] = _NEVER

    def _tick(self, ids: Int[np.ndarray, " active"]) -> Bool[np.ndarray, " active"]:
        """One step of each copy; those that end their motion hold where they are, or should be, until `_end`."""
        simulation, gripper = self.simulation, self.gripper
        self._drive(ids)
        simulation.step(ids)
        moving = ids[self._end[ids] == _NEVER]
        gap = self._to[moving] - simulation.qpos[moving, :2]
        arrived = (gap * gap).sum(1) < gripper.tolerance**2
        arrived &= np.abs(simulation.qvel[moving, :2]).max(1, initial=0.0) < gripper.tolerance
        late = ~arrived & (self._clock[moving] == round(gripper.timeout / simulation.dt))
        bad = self._clock[moving] % 5 == 0
        bad[bad] = simulation.diverged(moving[bad])
        for ended, outcome in ((late, _TIMEOUT), (arrived, _TARGET), (bad, _DIVERGED)):
            self._outcome[moving[ended]] = outcome
        self._to[moving[late]] = simulation.qpos[moving[late], :2]
        ended = moving[arrived | late | bad]
        self._from[ended] = self._to[ended]
        self._end[ended] = self._clock[ended] + self._settle_steps
        return np.asarray(self._clock[ids] == self._end[ids])

    def _drive(self, ids: Int[np.ndarray, " active"]) -> None:
        """Set the gripper forces for the set-points, each of which left `_from` as its clock began."""
        gripper, start, way = self.gripper, self._from[ids], self._to[ids] - self._from[ids]
        length = np.sqrt((way * way).sum(1, keepdims=True)) + 1e-12
        travelled, speed = gripper.profile(length, self._clock[ids, None] * self.simulation.dt)
        direction = way / length
        setpoint, velocity = start + travelled * direction, speed * direction
        force = gripper.kp * (setpoint - self.simulation.qpos[ids, :2]) + gripper.kv * (
            velocity - self.simulation.qvel[ids, :2]
        )
        size = np.sqrt((force * force).sum(1, keepdims=True))
        self.simulation.ctrl[ids] = force * np.minimum(1.0, gripper.force / (size + 1e-12))
