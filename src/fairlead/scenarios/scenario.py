"""What a scenario is: a state layout, random actions, environments, starts, goals, and worlds to act in."""

# pyright: reportAttributeAccessIssue=false
# MuJoCo ships no type stubs.

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import final

import mujoco
import numpy as np
from jaxtyping import Float

from fairlead.core.errors import FairleadError, FileFormatError
from fairlead.core.layout import StateLayout
from fairlead.core.marks import marks
from fairlead.core.roles import Environment
from fairlead.geometry.motion import RandomDisplacement
from fairlead.geometry.shapes import Box, Obstacle, box_distance
from fairlead.scenarios.arms import Arms
from fairlead.scenarios.render import Colour, SceneRenderer, plain_backdrop
from fairlead.scenarios.rope import RopeFactors
from fairlead.scenarios.scene_files import Scene, SceneSet, read_scenes
from fairlead.scenarios.simulate import SimulatedWorld


class Scenario(ABC):
    """One scenario of the paper, or a user's own. The rest of the package sees it through this alone.

    What has a value or a body here suits a world of points; ropes, arms and finer pictures have more to say.
    """

    name: str
    layout: StateLayout
    sampler: RandomDisplacement
    unconstrained_sampler: RandomDisplacement
    rope_radius: float = 0.01
    """How thick the object is about its points [m]."""
    link_length: float = math.inf
    """How far apart two neighbouring points of the object can be [m]."""
    gripper_speed: float = 0.2
    """How fast a gripper moves [m / s]: an exported plan is timed by it."""
    paper_data: tuple[tuple[int, int], tuple[int, int]] = (2048, 10), (2048, 20)
    """Trajectories, and actions in each, that the paper recorded or a scenario wants: in phase 1, in phase 2."""
    arms: Arms | None = None
    """What carries the grippers, where something does: pictures show it, checks and recovery ask what it can do."""

    base: str | None = None
    """The scenario whose presets a task takes, and whose models it may use; None: only its own."""
    colours: Mapping[str, Colour] = MappingProxyType({})
    """Of obstacles in pictures, by name; the others are grey."""

    @property
    @final
    def kin(self) -> tuple[str, ...]:
        """Names of the scenarios whose models this one may use."""
        return (self.name,) if self.base is None else (self.name, self.base)

    @abstractmethod
    def environment(self, obstacles: Sequence[Obstacle]) -> Environment:
        """The obstacles, with what is fixed in this scenario (walls, table), as a field."""

    @abstractmethod
    def simulate(
        self,
        obstacles: Sequence[Sequence[Obstacle]],
        states: Float[np.ndarray, "batch state"],
        threads: int = 1,
    ) -> SimulatedWorld:
        """One simulation for each row: obstacles placed, the object laid at the given points and settled.

        `scenarios.computed.ComputedWorld` is one for worlds that a function computes.
        """

    @abstractmethod
    def simulate_unconstrained(self, states: Float[np.ndarray, "batch state"], threads: int = 1) -> SimulatedWorld:
        """As `simulate`, without any physical constraint: where the dynamics are learned (phase 1)."""

    def altered(self, factors: RopeFactors, arms: Arms | None = None) -> Scenario:
        """The same scenario with another rope and, where arms carry it, others if given: for execution elsewhere.

        Raises:
            FairleadError: something differs, and this scenario knows no rope but its own.
        """
        if factors == RopeFactors() and arms is None:
            return self
        raise FairleadError(f"scenario '{self.name}' knows no rope but its own")

    def backdrop(self) -> mujoco.MjModel:
        """What pictures show behind every scene: lights, a camera called `view`, and what never moves."""
        return plain_backdrop(self.environment(()).bounds)

    @abstractmethod
    def random_start(self, rng: np.random.Generator) -> Float[np.ndarray, " state"]:
        """A start without obstacles."""

    @abstractmethod
    def rearrange(
        self, states: Float[np.ndarray, "batch state"], rngs: Sequence[np.random.Generator], threads: int = 1
    ) -> tuple[list[tuple[Obstacle, ...]], Float[np.ndarray, "batch state"]]:
        """New obstacles for each row, drawn from its own stream, and the state in which the object is among them."""

    @abstractmethod
    def random_scene(self, rng: np.random.Generator, name: str) -> Scene:
        """A scene like the paper's test scenes: obstacles, a start and a goal."""

    def validate(self, scene: Scene) -> None:  # noqa: B027
        """Raise FairleadError for a scene that cannot be simulated or solved by anyone."""

    def scenes(self, path: Path) -> SceneSet:
        """Read and validate a scene file of this scenario."""
        scenes = read_scenes(path, self.name, self.layout)
        for i, scene in enumerate(scenes.scenes):
            try:
                require_places_within(scene, self.environment(scene.obstacles).bounds)
                self.validate(scene)
            except FairleadError as error:
                raise FileFormatError(path, f"scenes[{i}]", str(error)) from None
        return scenes

    def renderer(self, scene: Scene, width: int = 800, height: int = 800, shadows: bool = True) -> SceneRenderer:
        """Draws states of a scene."""
        goal = marks(scene.goal.written())
        return SceneRenderer(
            self.backdrop(),
            self.layout,
            self.rope_radius,
            scene.obstacles,
            goal,
            width,
            height,
            self.arms,
            self.colours,
            shadows,
        )


def require_places_within(scene: Scene, bounds: Float[np.ndarray, "2 3"]) -> None:
    """Raise FairleadError where the goal has a place outside the region where states may lie."""
    low, high = bounds
    for mark in marks(scene.goal.written()):
        if "size" not in mark and not ((low <= mark["position"]) & (mark["position"] <= high)).all():
            within = f"{low.round(4).tolist()} to {high.round(4).tolist()}"
            raise FairleadError(f"scene '{scene.name}': {mark['where']}.position lies outside the bounds, {within}")


def require_free_places(scene: Scene, boxes: Sequence[Box]) -> None:
    """Raise FairleadError where the goal has a place inside one of the boxes."""
    for mark in marks(scene.goal.written()):
        if "size" not in mark and box_distance(boxes, np.array(mark["position"])) < 0:
            raise FairleadError(f"scene '{scene.name}': {mark['where']}.position lies inside an obstacle")
