"""A task: a scenario's rope, grippers and dynamics in surroundings of its own, with starts and goals of its own.

Paper, "Physical robot demonstrations": mock-ups of domestic and automotive tasks, planned with the dynamics learned for
the scenario that a task is based on.
"""

# pyright: reportAttributeAccessIssue=false
# MuJoCo ships no type stubs.

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import mujoco
import numpy as np
from jaxtyping import Float

from fairlead.core.errors import FairleadError, SamplingError
from fairlead.core.roles import Environment
from fairlead.geometry.goals import SceneGoal
from fairlead.geometry.shapes import Obstacle
from fairlead.scenarios.arms import Arms
from fairlead.scenarios.render import Colour
from fairlead.scenarios.rope import RopeFactors
from fairlead.scenarios.scenario import Scenario
from fairlead.scenarios.scene_files import Scene
from fairlead.scenarios.simulate import SimulatedWorld

TRIES = 200
MOVED = 0.01
"""A start that settles farther than this from its points [m] is drawn again."""
Starts = Callable[[Any, Sequence[Sequence[Obstacle]], Sequence[np.random.Generator], int], np.ndarray]
"""From the base, obstacles and a stream for each row, and a number of threads: a start among each row's obstacles."""


@dataclass(frozen=True)
class TaskSpec:
    """What makes a task.

    Args:
        name: of the task.
        base: makes the scenario whose rope, grippers, dynamics and presets it takes.
        obstacles: a variation of the surroundings; sizes and order of the boxes are always the same.
        starts: where scenes start.
        among: where the trajectories of phase 2 start, for a classifier of the task's own.
        goal: of a scene, from the base, the obstacles and a random stream.
        colours: of obstacles in pictures, by name.
        view: where the camera is and what it looks at [m]; None for the base's.
    """

    name: str
    base: Callable[[], Scenario]
    obstacles: Callable[[np.random.Generator], tuple[Obstacle, ...]]
    starts: Starts
    among: Starts
    goal: Callable[[Any, tuple[Obstacle, ...], np.random.Generator], SceneGoal]
    colours: Mapping[str, Colour]
    view: tuple[Sequence[float], Sequence[float]] | None = None


@final
class Task(Scenario):
    """The scenario of a task; `world` is its base, or an altered one."""

    def __init__(self, spec: TaskSpec, world: Scenario | None = None) -> None:
        self._spec, self._world = spec, world or spec.base()
        self.name, self.base, self.colours = spec.name, self._world.name, spec.colours
        self.layout, self.arms = self._world.layout, self._world.arms
        self.sampler, self.unconstrained_sampler = self._world.sampler, self._world.unconstrained_sampler
        self.rope_radius, self.link_length = self._world.rope_radius, self._world.link_length
        self.paper_data, self.gripper_speed = self._world.paper_data, self._world.gripper_speed

    def environment(self, obstacles: Sequence[Obstacle]) -> Environment:
        return self._world.environment(obstacles)

    def simulate(
        self, obstacles: Sequence[Sequence[Obstacle]], states: Float[np.ndarray, "batch state"], threads: int = 1
    ) -> SimulatedWorld:
        return self._world.simulate(obstacles, states, threads)

    def simulate_unconstrained(self, states: Float[np.ndarray, "batch state"], threads: int = 1) -> SimulatedWorld:
        return self._world.simulate_unconstrained(states, threads)

    def altered(self, factors: RopeFactors, arms: Arms | None = None) -> Task:
        return Task(self._spec, self._world.altered(factors, arms))

    def backdrop(self) -> mujoco.MjModel:
        model = self._world.backdrop()
        if self._spec.view is not None:
            position, target = map(np.array, self._spec.view)
            back = (position - target) / np.linalg.norm(position - target)
            right = np.cross([0.0, 0.0, 1.0], back)
            right /= np.linalg.norm(right)
            model.camera("view").pos[:] = position
            axes = np.stack([right, np.cross(back, right), back], axis=1)
            mujoco.mju_mat2Quat(model.camera("view").quat, axes.ravel())
        return model

    def random_start(self, rng: np.random.Generator) -> Float[np.ndarray, " state"]:
        return self._world.random_start(rng)

    def rearrange(
        self, states: Float[np.ndarray, "batch state"], rngs: Sequence[np.random.Generator], threads: int = 1
    ) -> tuple[list[tuple[Obstacle, ...]], Float[np.ndarray, "batch state"]]:
        """The rope starts anew among new surroundings; the new state owes nothing to the old one."""
        del states
        obstacles = [self._spec.obstacles(rng) for rng in rngs]
        return obstacles, self._spec.among(self._world, obstacles, rngs, threads)

    def random_scene(self, rng: np.random.Generator, name: str) -> Scene:
        """A variation of the surroundings, a start among them at which the rope rests, and a goal."""
        problem = "the rope does not rest at its start"
        for _ in range(TRIES):
            obstacles = self._spec.obstacles(rng)
            try:
                (start,) = self._spec.starts(self._world, [obstacles], [rng], 1)
                goal = self._spec.goal(self._world, obstacles, rng)
                scene = Scene.starting(self.layout, name, obstacles, start, goal)
                self.validate(scene)
            except FairleadError as error:
                problem = str(error)
                continue
            if self.simulate([obstacles], scene.state(self.layout)[None]).residual[0] < MOVED:
                return scene
        raise SamplingError(f"scene of task '{self.name}'", TRIES, f"look at what was wrong last: {problem}")

    def validate(self, scene: Scene) -> None:
        self._world.validate(scene)


def clear(world: Scenario, obstacles: Sequence[Obstacle], state: Float[np.ndarray, " state"]) -> bool:
    """Whether a rope touches nothing, with as much as its radius to spare."""
    distance = world.environment(obstacles).signed_distance(world.layout.points_of(state))
    return bool(distance.min() > 2 * world.rope_radius)
