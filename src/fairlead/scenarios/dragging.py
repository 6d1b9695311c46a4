"""Scenario 1 of the paper: dragging a rope along the floor of a walled arena, among cubes and L-shaped corners."""

# pyright: reportAttributeAccessIssue=false
# MuJoCo ships no type stubs.

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import final

import mujoco
import numpy as np
from jaxtyping import Float, Int

from fairlead.core.errors import FairleadError, SamplingError
from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome, Executed
from fairlead.geometry.fields import BoxEnvironment
from fairlead.geometry.goals import PointGoal
from fairlead.geometry.motion import RandomDisplacement
from fairlead.geometry.shapes import Box, Obstacle
from fairlead.scenarios.obstacles import Sizes, add_boxes, box_poses, box_sizes, place_apart
from fairlead.scenarios.rope import FLOOR_BIT, OBSTACLE_BIT, PlanarRope
from fairlead.scenarios.scenario import Scenario
from fairlead.scenarios.scene_files import GoalSpec, Scene
from fairlead.scenarios.simulate import SimulatedWorld, Simulation, base_options

LAYOUT = StateLayout(("gripper",), 10)
TARGETS = {"tail": 0, "midpoint": 5}
_OUTCOMES = tuple(ActionOutcome)
ARENA = 2.0
WALLS = tuple(
    Box((0.1, ARENA + 0.1, 0.3) if side[0] else (ARENA + 0.1, 0.1, 0.3), (side[0], side[1], 0.15))
    for side in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
)
CUBE = Obstacle("cube", (Box((0.25, 0.25, 0.25), (0.0, 0.0, 0.0)),))
_QUARTER = (0.0, 0.0, float(np.sqrt(0.5)), float(np.sqrt(0.5)))
CORNER = Obstacle(
    "corner", (Box((0.5, 0.08, 0.1), (0.0, 0.0, 0.0)), Box((0.2, 0.08, 0.1), (0.21, 0.10, 0.0), _QUARTER))
)
OBSTACLES = (*(Obstacle(f"box{i + 1}", CUBE.boxes) for i in range(6)),
             *(Obstacle(f"corner{i + 1}", CORNER.boxes) for i in range(3)))  # fmt: skip


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
        """Lay every rope at the given points, at rest, and let it settle."""
        qpos = np.zeros_like(self.simulation.qpos)
        qpos[:, :2] = states[:, :2]
        headings = self.rope.headings(states[:, :3], LAYOUT.points_of(states))
        qpos[:, self._hinges] = self.rope.joint_angles(headings)
        self.simulation.qpos[:], self.simulation.qvel[:] = qpos, 0.0
        self._settle(self._all, self.simulation.qpos[:, :2].copy())

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
        self._settle(self._all, hold)
        bad = self.simulation.diverged(self._all)
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
            if k % 5 == 0:
                arrived |= simulation.diverged(active)
            if arrived.any():
                taken[active[arrived]] = k
                outcomes[active[arrived]] = _OUTCOMES.index(ActionOutcome.TARGET)
                active = active[~arrived]
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

    def _settle(self, ids: Int[np.ndarray, " active"], hold: Float[np.ndarray, "active 2"]) -> None:
        """Hold the grippers and wait until the rope rests; what is left of its velocity is dropped."""
        for _ in range(round(self.gripper.settle / self.simulation.dt)):
            self._drive(ids, hold, hold, 1.0)
            self.simulation.step(ids)
        self.simulation.qvel[ids] = 0.0


@final
class Dragging(Scenario):
    """The rope-dragging scenario. `rope` and `gripper` are the physics; their defaults are the paper's."""

    name = "dragging"
    layout = LAYOUT

    def __init__(self, rope: PlanarRope | None = None, gripper: Gripper | None = None) -> None:
        self.rope, self.gripper = rope or PlanarRope(), gripper or Gripper()
        self.rope_radius, self.link_length = self.rope.radius, self.rope.link_length
        inside = ARENA / 2 - WALLS[0].size[0] / 2
        z = self.rope.height
        self.bounds = np.array([[-inside, -inside, 0.0], [inside, inside, 2 * z]])
        self.sampler = RandomDisplacement(LAYOUT, 0.15, (-inside, -inside, z), (inside, inside, z), planar=True)
        self.unconstrained_sampler = RandomDisplacement(
            LAYOUT, 0.15, (-np.inf, -np.inf, z), (np.inf, np.inf, z), planar=True
        )

    def environment(self, obstacles: Sequence[Obstacle]) -> BoxEnvironment:
        return BoxEnvironment([*WALLS, *(box for o in obstacles for box in o.boxes)], self.bounds)

    def goal(self, scene: Scene) -> PointGoal:
        if scene.goal.target not in TARGETS:
            raise FairleadError(
                f"scene '{scene.name}': goal.target '{scene.goal.target}'; allowed: {', '.join(TARGETS)}"
            )
        return PointGoal(LAYOUT, TARGETS[scene.goal.target], scene.goal.position, scene.goal.radius)

    def simulate(
        self, obstacles: Sequence[Sequence[Obstacle]], states: Float[np.ndarray, "batch state"], threads: int = 1
    ) -> DraggingWorld:
        return DraggingWorld(obstacles, np.asarray(states, float), threads, self.rope, self.gripper)

    def simulate_unconstrained(self, states: Float[np.ndarray, "batch state"], threads: int = 1) -> DraggingWorld:
        return DraggingWorld(None, np.asarray(states, float), threads, self.rope, self.gripper)

    def backdrop(self) -> mujoco.MjModel:
        spec = mujoco.MjSpec()
        checker = spec.add_texture(name="checker", type=mujoco.mjtTexture.mjTEXTURE_2D, width=512, height=512,
                                   builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER, rgb1=[0.93, 0.94, 0.95],
                                   rgb2=[0.88, 0.90, 0.92])  # fmt: skip
        material = spec.add_material(name="checker", texrepeat=[8, 8])
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = checker.name
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 0.1], material="checker")
        for wall in WALLS:
            spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=np.array(wall.size) * [0.5, 0.5, 0.2],
                                    pos=[*wall.position[:2], 0.06], rgba=[0.35, 0.39, 0.45, 1])  # fmt: skip
        spec.worldbody.add_light(pos=[0.6, -0.9, 3], dir=[-0.2, 0.3, -1], diffuse=[0.45, 0.45, 0.45])
        spec.worldbody.add_camera(name="view", pos=[0, -0.62, 2.9], xyaxes=[1, 0, 0, 0, 0.978, 0.21], fovy=45)
        spec.add_texture(type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
                         rgb1=[1, 1, 1], rgb2=[1, 1, 1], width=64, height=384)  # fmt: skip
        spec.visual.headlight.ambient = [0.3, 0.3, 0.3]
        spec.visual.headlight.diffuse = [0.3, 0.3, 0.3]
        spec.visual.headlight.specular = [0.0, 0.0, 0.0]
        spec.visual.quality.shadowsize = 4096
        return spec.compile()

    def random_start(self, rng: np.random.Generator) -> Float[np.ndarray, " state"]:
        """A gently bent rope somewhere in the arena."""
        for _ in range(1000):
            bends = rng.normal(0, 0.3, self.rope.links)
            heading = (rng.uniform(-np.pi, np.pi) + np.cumsum(bends))[::-1]
            state = np.full(LAYOUT.state_size, self.rope.height)
            state[:2] = rng.uniform(-0.8, 0.8, 2)
            direction = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
            LAYOUT.points_of(state)[:, :2] = state[:2] + self.rope.centre_weights @ direction
            if np.abs(LAYOUT.points_of(state)[:, :2]).max() < self.bounds[1, 0] - 2 * self.rope.radius:
                return state
        raise SamplingError("start inside the arena", 1000, "use a shorter rope")

    def random_obstacles(self, state: Float[np.ndarray, " state"], rng: np.random.Generator) -> tuple[Obstacle, ...]:
        clear = state.reshape(-1, 3)
        between = (clear[1:] + clear[:-1]) / 2
        return place_apart(
            OBSTACLES, -0.85, 0.85, np.concatenate([clear, between]), self.rope.radius + 0.004, rng, WALLS
        )

    def random_goal(self, obstacles: Sequence[Obstacle], rng: np.random.Generator) -> GoalSpec:
        """The tail's goal, uniform in [-0.7, 0.7]^2, at least 0.10 m from obstacles; not checked for reachability."""
        environment = self.environment(obstacles)
        for _ in range(10_000):
            position = np.array([*rng.uniform(-0.7, 0.7, 2), self.rope.height])
            if environment.signed_distance(position) > 0.10:
                return GoalSpec("tail", tuple(map(float, position)), 0.05)
        raise SamplingError("goal clear of the obstacles", 10_000, "use fewer obstacles")

    def random_scene(self, rng: np.random.Generator, name: str) -> Scene:
        """Obstacles around a rope, then twenty random actions that may leave it in contact, then a goal."""
        state = self.random_start(rng)
        obstacles = self.random_obstacles(state, rng)
        world = self.simulate([obstacles], state[None])
        displacement = self.sampler.displacements(1, rng)
        for _ in range(20):
            displacement = self.sampler.redraw(displacement, np.array([True]), rng)
            world.execute(self.sampler.targets(world.observe(), displacement))
        start = world.observe()[0].round(5)
        return Scene(
            name, obstacles, {"gripper": tuple(start[:3].tolist())},
            tuple(map(tuple, LAYOUT.points_of(start).tolist())), self.random_goal(obstacles, rng),
        )  # fmt: skip

    def validate(self, scene: Scene) -> None:
        """A goal inside an obstacle, or a start outside the arena, is an error that names the field."""
        environment = self.environment(scene.obstacles)
        goal = self.goal(scene)
        if environment.signed_distance(goal.position) < 0:
            raise FairleadError(f"scene '{scene.name}': goal.position lies inside an obstacle or wall")
        start = scene.state(LAYOUT).reshape(-1, 3)
        if (np.abs(start[:, :2]) > self.bounds[1, :2]).any():
            raise FairleadError(f"scene '{scene.name}': the rope starts outside the arena")
        if (environment.signed_distance(start) < 0).any():
            raise FairleadError(f"scene '{scene.name}': the rope starts inside an obstacle")
