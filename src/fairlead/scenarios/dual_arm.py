"""Scenario 2 of the paper: two arms hold the ends of a rope above a cluttered table and place its midpoint."""

# pyright: reportAttributeAccessIssue=false
# MuJoCo ships no type stubs.

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import mujoco
import numpy as np
from jaxtyping import Float

from fairlead.core.errors import FairleadError, SamplingError
from fairlead.core.records import ActionOutcome
from fairlead.geometry.fields import BoxEnvironment
from fairlead.geometry.goals import PointsGoal, point_goal
from fairlead.geometry.motion import RandomDisplacement
from fairlead.geometry.shapes import Box, Obstacle, box_distance
from fairlead.scenarios.arms import Arms
from fairlead.scenarios.dual_arm_world import LAYOUT, TABLE, DualArmWorld, Grippers
from fairlead.scenarios.hanging_rope import HangingRope
from fairlead.scenarios.iiwa import add_torso, dual_iiwa
from fairlead.scenarios.rope import RopeFactors
from fairlead.scenarios.scenario import Scenario, require_free_places
from fairlead.scenarios.scene_files import Scene

BOUNDS = np.array([[0.45, -0.6, 0.6], [1.2, 0.6, 1.3]])
PHASE_1_APART, START_APART = 0.70, 0.76
"""Largest distances between the grippers [m]: in phase 1 (the paper's), and where a scene starts."""
GRASP = np.array([[[0.75, 0.25, 1.22], [0.75, -0.35, 1.22]], [[0.90, 0.35, 1.28], [0.90, -0.25, 1.28]]])
"""Where the rope is grasped: lowest and highest positions of the left and the right gripper [m], above any obstacle."""
POSE = np.array([[[0.6, -0.05, 0.85], [0.6, -0.5, 0.85]], [[1.1, 0.5, 1.3], [1.1, 0.05, 1.3]]])
"""Where a scene starts, likewise."""
LEG, LEGS = 0.2, 4
"""From the grasp to the start of a scene: at most so many straight motions of at most so many metres."""


def _box(name: str, *size: float) -> Obstacle:
    """A box that stands 25 mm deep in the table, as the authors' do."""
    return Obstacle(name, (Box(size, (0.0, 0.0, 0.6 + size[2] / 2)),))


OBSTACLES = (
    _box("box1", 0.10, 0.05, 0.20), _box("box2", 0.11, 0.06, 0.21), _box("box3", 0.09, 0.07, 0.26),
    _box("box4", 0.06, 0.04, 0.14), _box("box5", 0.05, 0.16, 0.30),
    Obstacle("hook1", (Box((0.04, 0.14, 0.18), (0.0, 0.0, 0.67)), Box((0.20, 0.14, 0.02), (-0.08, 0.0, 0.77)))),
    Obstacle("hook2", (Box((0.04, 0.08, 0.28), (0.0, 0.0, 0.71)), Box((0.18, 0.08, 0.02), (0.0, 0.0, 0.85)))),
)  # fmt: skip


@final
class DualArm(Scenario):
    """The dual-arm scenario. `rope` and `motion` are the physics, see docs/adr/0004; `arms` carry the grippers."""

    name = "dual_arm"
    layout = LAYOUT
    paper_data = (2048, 10), (5996, 20)

    def __init__(
        self, rope: HangingRope | None = None, motion: Grippers | None = None, arms: Arms | None = None
    ) -> None:
        self.rope, self.motion, self._arms = rope or HangingRope(), motion or Grippers(), arms or dual_iiwa()
        self.arms, self.gripper_speed = self._arms, self.motion.speed
        self.rope_radius, self.link_length = self.rope.radius, self.rope.link_length
        low, high = map(tuple, BOUNDS.tolist())
        self.sampler = RandomDisplacement(LAYOUT, 0.10, low, high, planar=False)
        self.unconstrained_sampler = RandomDisplacement(LAYOUT, 0.10, low, high, planar=False, apart=PHASE_1_APART)

    def environment(self, obstacles: Sequence[Obstacle]) -> BoxEnvironment:
        return BoxEnvironment([TABLE, *(box for o in obstacles for box in o.boxes)], BOUNDS)

    def simulate(
        self, obstacles: Sequence[Sequence[Obstacle]], states: Float[np.ndarray, "batch state"], threads: int = 1
    ) -> DualArmWorld:
        return DualArmWorld(obstacles, np.asarray(states, float), threads, self.rope, self.motion, self.arms)

    def simulate_unconstrained(self, states: Float[np.ndarray, "batch state"], threads: int = 1) -> DualArmWorld:
        return DualArmWorld(None, np.asarray(states, float), threads, self.rope, self.motion, None)

    def altered(self, factors: RopeFactors, arms: Arms | None = None) -> DualArm:
        return DualArm(self.rope.altered(factors), self.motion, arms or self._arms)

    def backdrop(self) -> mujoco.MjModel:
        spec = mujoco.MjSpec()
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=np.array(TABLE.size) / 2, pos=TABLE.position,
                                rgba=[0.88, 0.86, 0.82, 1])  # fmt: skip
        add_torso(spec)
        spec.worldbody.add_light(pos=[1.6, -0.9, 3], dir=[-0.3, 0.3, -1], diffuse=[0.45, 0.45, 0.45])
        spec.worldbody.add_camera(name="view", pos=[2.35, 0.25, 1.75], xyaxes=[-0.15, 1, 0, -0.5, -0.075, 1], fovy=45)
        spec.add_texture(type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
                         rgb1=[1, 1, 1], rgb2=[1, 1, 1], width=64, height=384)  # fmt: skip
        spec.visual.headlight.ambient = [0.3, 0.3, 0.3]
        spec.visual.headlight.diffuse = [0.3, 0.3, 0.3]
        spec.visual.headlight.specular = [0.0, 0.0, 0.0]
        spec.visual.quality.shadowsize = 2048
        return spec.compile()

    def random_start(self, rng: np.random.Generator) -> Float[np.ndarray, " state"]:
        """A rope that hangs freely."""
        return self._hanging(POSE, PHASE_1_APART, rng)

    def _hanging(
        self, region: Float[np.ndarray, "2 2 3"], apart: float, rng: np.random.Generator
    ) -> Float[np.ndarray, " state"]:
        grippers = _held(region, apart, rng)
        return LAYOUT.join(grippers, self.rope.hanging(grippers))

    def random_obstacles(self, state: Float[np.ndarray, " state"], rng: np.random.Generator) -> tuple[Obstacle, ...]:
        """Anywhere on the table, at any yaw, overlapping as they may, but each clear of the rope."""
        points, placed = LAYOUT.points_of(state), []
        for _ in range(1000):
            x, y, yaw = rng.uniform(0.6, 1.0), rng.uniform(-0.45, 0.45), rng.uniform(-np.pi, np.pi)
            moved = OBSTACLES[len(placed)].moved((x, y, 0.0), yaw)
            if box_distance(moved.boxes, points).min() > 2 * self.rope.radius:
                placed.append(moved)
            if len(placed) == len(OBSTACLES):
                return tuple(placed)
        raise SamplingError("free place for the obstacles", 1000, "start with the rope higher above the table")

    def rearrange(
        self, states: Float[np.ndarray, "batch state"], rngs: Sequence[np.random.Generator], threads: int = 1
    ) -> tuple[list[tuple[Obstacle, ...]], Float[np.ndarray, "batch state"]]:
        """The rope is released and grasped again above new obstacles, then carried to a random pose among them.

        The new state owes nothing to the old one. Grippers stop on the way where they are stopped.
        """
        states = np.stack([self.grasped(rng) for rng in rngs])
        obstacles = [self.random_obstacles(state, rng) for state, rng in zip(states, rngs, strict=True)]
        return obstacles, self.carried(obstacles, states, rngs, threads)

    def grasped(self, rng: np.random.Generator) -> Float[np.ndarray, " state"]:
        """A rope that hangs freely, grasped above any obstacle."""
        return self._hanging(GRASP, START_APART, rng)

    def carried(
        self,
        obstacles: Sequence[Sequence[Obstacle]],
        states: Float[np.ndarray, "batch state"],
        rngs: Sequence[np.random.Generator],
        threads: int = 1,
    ) -> Float[np.ndarray, "batch state"]:
        """The states after the grippers were carried to random poses, or as far as they got, and the rope settled."""
        poses = np.stack([_held(POSE, START_APART, rng) for rng in rngs])
        world, left = self.simulate(obstacles, states, threads), np.arange(len(rngs))
        for _ in range(LEGS):
            at = LAYOUT.grippers_of(world.observe())[left]
            way = poses[left] - at
            longest = np.linalg.norm(way, axis=-1).max(axis=1)
            target = at + way * np.minimum(1.0, LEG / np.maximum(longest, 1e-9))[:, None, None]
            done = world.carry(left, target.reshape(len(left), -1))
            left = left[(done.outcomes == ActionOutcome.TARGET.number) & (longest > LEG)]
            if not len(left):
                break
        return world.observe()

    def random_goal(self, obstacles: Sequence[Obstacle], rng: np.random.Generator) -> PointsGoal:
        """The midpoint's goal, at least 0.05 m from obstacles (the table is none); not checked for reachability."""
        boxes = [box for obstacle in obstacles for box in obstacle.boxes]
        for _ in range(10_000):
            position = rng.uniform([0.6, -0.4, 0.6], [1.1, 0.4, 0.85])
            if box_distance(boxes, position) > 0.05:
                return point_goal(LAYOUT, "midpoint", position, 0.05)
        raise SamplingError("goal clear of the obstacles", 10_000, "use fewer obstacles")

    def random_scene(self, rng: np.random.Generator, name: str) -> Scene:
        """As the authors made theirs: obstacles, a rope grasped above them and carried to a random pose, a goal."""
        (obstacles,), (state,) = self.rearrange(np.empty((1, 0)), [rng])
        return self.scene(name, obstacles, state, rng)

    def scene(
        self, name: str, obstacles: tuple[Obstacle, ...], state: Float[np.ndarray, " state"], rng: np.random.Generator
    ) -> Scene:
        """A scene that starts in `state`, with a random goal."""
        return Scene.starting(LAYOUT, name, obstacles, state, self.random_goal(obstacles, rng))

    def validate(self, scene: Scene) -> None:
        """A goal or rope inside an obstacle, a rope too short or grippers out of reach is an error that names it."""
        boxes = [box for obstacle in scene.obstacles for box in obstacle.boxes]
        require_free_places(scene, boxes)
        state = scene.state(LAYOUT)
        if box_distance([TABLE, *boxes], LAYOUT.points_of(state)).min() < 0:
            raise FairleadError(f"scene '{scene.name}': the rope starts inside an obstacle or the table")
        apart = np.linalg.norm(np.subtract(*LAYOUT.grippers_of(state)))
        if apart > self.rope.length:
            raise FairleadError(
                f"scene '{scene.name}': the grippers are {apart:.3f} m apart; the rope is {self.rope.length:.3f} m long"
            )
        if not self._arms.grasp(LAYOUT.grippers_of(state)[None])[1][0]:
            raise FairleadError(f"scene '{scene.name}': the arms do not reach its grippers")


def _held(region: Float[np.ndarray, "2 2 3"], apart: float, rng: np.random.Generator) -> Float[np.ndarray, "2 3"]:
    """Random gripper positions [m], at least 0.2 m and at most `apart` from each other."""
    while True:
        grippers = rng.uniform(*region)
        if 0.2 < np.linalg.norm(grippers[0] - grippers[1]) < apart:
            return grippers
