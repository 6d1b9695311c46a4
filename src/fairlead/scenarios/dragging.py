"""Scenario 1 of the paper: dragging a rope along the floor of a walled arena, among cubes and L-shaped corners."""

# pyright: reportAttributeAccessIssue=false
# MuJoCo ships no type stubs.

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import mujoco
import numpy as np
from jaxtyping import Float

from fairlead.core.errors import FairleadError, SamplingError
from fairlead.geometry.fields import BoxEnvironment
from fairlead.geometry.goals import PointsGoal, point_goal
from fairlead.geometry.motion import RandomDisplacement
from fairlead.geometry.shapes import Box, Obstacle
from fairlead.scenarios.arms import Arms
from fairlead.scenarios.dragging_world import ARENA, LAYOUT, WALLS, DraggingWorld, Gripper
from fairlead.scenarios.obstacles import place_apart
from fairlead.scenarios.rope import PlanarRope, RopeFactors
from fairlead.scenarios.scenario import Scenario, require_free_places
from fairlead.scenarios.scene_files import Scene

CUBE = Obstacle("cube", (Box((0.25, 0.25, 0.25), (0.0, 0.0, 0.0)),))
_QUARTER = (0.0, 0.0, float(np.sqrt(0.5)), float(np.sqrt(0.5)))
CORNER = Obstacle(
    "corner", (Box((0.5, 0.08, 0.1), (0.0, 0.0, 0.0)), Box((0.2, 0.08, 0.1), (0.21, 0.10, 0.0), _QUARTER))
)
OBSTACLES = (*(Obstacle(f"box{i + 1}", CUBE.boxes) for i in range(6)),
             *(Obstacle(f"corner{i + 1}", CORNER.boxes) for i in range(3)))  # fmt: skip


@final
class Dragging(Scenario):
    """The rope-dragging scenario. `rope` and `gripper` are the physics; their defaults are the paper's, or
    docs/adr/0001's where the paper is silent."""

    name = "dragging"
    layout = LAYOUT
    paper_data = (6144, 10), (2048, 50)

    def __init__(self, rope: PlanarRope | None = None, gripper: Gripper | None = None) -> None:
        self.rope, self.gripper = rope or PlanarRope(), gripper or Gripper()
        self.rope_radius, self.link_length = self.rope.radius, self.rope.link_length
        self.gripper_speed = self.gripper.speed
        inside = ARENA / 2 - WALLS[0].size[0] / 2
        z = self.rope.height
        self.bounds = np.array([[-inside, -inside, 0.0], [inside, inside, 2 * z]])
        self.sampler = RandomDisplacement(LAYOUT, 0.15, (-inside, -inside, z), (inside, inside, z), planar=True)
        self.unconstrained_sampler = RandomDisplacement(
            LAYOUT, 0.15, (-np.inf, -np.inf, z), (np.inf, np.inf, z), planar=True
        )

    def environment(self, obstacles: Sequence[Obstacle]) -> BoxEnvironment:
        return BoxEnvironment([*WALLS, *(box for o in obstacles for box in o.boxes)], self.bounds)

    def simulate(
        self, obstacles: Sequence[Sequence[Obstacle]], states: Float[np.ndarray, "batch state"], threads: int = 1
    ) -> DraggingWorld:
        return DraggingWorld(obstacles, np.asarray(states, float), threads, self.rope, self.gripper)

    def simulate_unconstrained(self, states: Float[np.ndarray, "batch state"], threads: int = 1) -> DraggingWorld:
        return DraggingWorld(None, np.asarray(states, float), threads, self.rope, self.gripper)

    def altered(self, factors: RopeFactors, arms: Arms | None = None) -> Dragging:
        return Dragging(self.rope.altered(factors), self.gripper)

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

    def rearrange(
        self, states: Float[np.ndarray, "batch state"], rngs: Sequence[np.random.Generator], threads: int = 1
    ) -> tuple[list[tuple[Obstacle, ...]], Float[np.ndarray, "batch state"]]:
        """The rope stays; the obstacles are placed anew around it."""
        del threads
        return [self.random_obstacles(state, rng) for state, rng in zip(states, rngs, strict=True)], states

    def random_goal(self, obstacles: Sequence[Obstacle], rng: np.random.Generator) -> PointsGoal:
        """The tail's goal, uniform in [-0.7, 0.7]^2, at least 0.10 m from obstacles; not checked for reachability."""
        environment = self.environment(obstacles)
        for _ in range(10_000):
            position = np.array([*rng.uniform(-0.7, 0.7, 2), self.rope.height])
            if environment.signed_distance(position) > 0.10:
                return point_goal(LAYOUT, "tail", position, 0.05)
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
        return Scene.starting(LAYOUT, name, obstacles, world.observe()[0], self.random_goal(obstacles, rng))

    def validate(self, scene: Scene) -> None:
        """A goal inside an obstacle, or a start outside the arena, is an error that names the field."""
        environment = self.environment(scene.obstacles)
        require_free_places(scene, environment.boxes)
        start = scene.state(LAYOUT).reshape(-1, 3)
        if (np.abs(start[:, :2]) > self.bounds[1, :2]).any():
            raise FairleadError(f"scene '{scene.name}': the rope starts outside the arena")
        if (environment.signed_distance(start) < 0).any():
            raise FairleadError(f"scene '{scene.name}': the rope starts inside an obstacle")
