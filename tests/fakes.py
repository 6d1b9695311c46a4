"""A scenario without physics: a chain of points that follows its gripper. Fast, deterministic, and it can diverge."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np

from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome, Executed
from fairlead.geometry.fields import BoxEnvironment
from fairlead.geometry.goals import point_goal
from fairlead.geometry.motion import RandomDisplacement
from fairlead.geometry.shapes import Box, Obstacle, box_distance
from fairlead.scenarios.scenario import Scenario
from fairlead.scenarios.scene_files import Scene
from fairlead.scenarios.simulate import SimulatedWorld

LAYOUT = StateLayout(("gripper",), 4)
LINK = 0.05
EDGE = 0.9
_INDEX = {outcome: i for i, outcome in enumerate(ActionOutcome)}


def follow(gripper: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Pull each point, from the gripper on, to within a link's length of the one before."""
    moved, leader = points.copy(), gripper
    for i in reversed(range(points.shape[1])):
        gap = moved[:, i] - leader
        length = np.linalg.norm(gap, axis=1, keepdims=True)
        moved[:, i] = leader + gap * np.minimum(1.0, LINK / np.maximum(length, 1e-12))
        leader = moved[:, i]
    return moved


@final
class FakeWorld(SimulatedWorld):
    """A gripper is blocked when its target lies in a box, and diverges where it starts in the `fragile` strip."""

    def __init__(self, obstacles: Sequence[Sequence[Obstacle]], states: np.ndarray, fragile: float) -> None:
        self._boxes = [[box for obstacle in row for box in obstacle.boxes] for row in obstacles]
        self._states, self._fragile, self._steps = states.astype(float), fragile, 0
        self._sent: dict[int, np.ndarray | None] = {}
        self._order = np.random.default_rng(abs(int(1e9 * states.sum())))

    @property
    def layout(self) -> StateLayout:
        return LAYOUT

    @property
    def residual(self) -> np.ndarray:
        return np.zeros(len(self._states))

    @property
    def steps(self) -> int:
        return self._steps

    def observe(self) -> np.ndarray:
        return self._states.copy()

    def restart(self, ids: np.ndarray, states: np.ndarray) -> None:
        self._states[ids] = states
        self._sent |= dict.fromkeys(ids.tolist())

    def send(self, ids: np.ndarray, actions: np.ndarray) -> None:
        self._sent |= dict(zip(ids.tolist(), actions, strict=True))

    def receive(self, wanted: int = 1) -> tuple[np.ndarray, Executed]:
        """One copy after the other, in an order that is another one in the next world."""
        index = int(self._order.choice(list(self._sent)))
        action = self._sent.pop(index)
        ids = np.array([index])
        if action is None:
            return ids, Executed(self._states[ids], np.zeros(1), np.zeros(1, int))
        actions = action[None]
        gripper = LAYOUT.grippers_of(self._states[ids])[:, 0]
        blocked = np.array([box_distance(self._boxes[index], actions[0]) < 0])
        diverged = gripper[:, 0] > EDGE - self._fragile
        target = np.where((blocked | diverged)[:, None], gripper, actions)
        points = follow(target, LAYOUT.points_of(self._states[ids]))
        self._states[ids] = LAYOUT.join(target[:, None], points)
        outcomes = np.where(blocked, _INDEX[ActionOutcome.TIMEOUT], _INDEX[ActionOutcome.TARGET])
        self._steps += 1
        seconds = np.where(blocked, 1.0, np.linalg.norm(target - gripper, axis=1) / 0.15)
        outcomes = np.where(diverged, _INDEX[ActionOutcome.DIVERGED], outcomes)
        return ids, Executed(self._states[ids], seconds, outcomes)


@final
class FakeScenario(Scenario):
    """`fragile`: width [m] of the strip at the right edge where a simulation diverges."""

    name = "fake"
    layout = LAYOUT
    rope_radius, link_length = 0.01, LINK
    paper_data = (64, 10), (16, 50)

    def __init__(self, fragile: float = 0.0) -> None:
        self.fragile = fragile
        low, high = (-EDGE, -EDGE, 0.0), (EDGE, EDGE, 0.0)
        self.sampler = self.unconstrained_sampler = RandomDisplacement(LAYOUT, 0.15, low, high, planar=True)

    def environment(self, obstacles: Sequence[Obstacle]) -> BoxEnvironment:
        bounds = np.array([[-1.0, -1.0, -0.01], [1.0, 1.0, 0.01]])
        return BoxEnvironment([box for obstacle in obstacles for box in obstacle.boxes], bounds)

    def simulate(self, obstacles: Sequence[Sequence[Obstacle]], states: np.ndarray, threads: int = 1) -> FakeWorld:
        del threads
        return FakeWorld(obstacles, states, self.fragile)

    def simulate_unconstrained(self, states: np.ndarray, threads: int = 1) -> FakeWorld:
        return self.simulate([()] * len(states), states, threads)

    def random_start(self, rng: np.random.Generator) -> np.ndarray:
        gripper = np.array([*rng.uniform(-0.5, 0.5, 2), 0.0])
        points = gripper + LINK * np.arange(LAYOUT.points, 0, -1)[:, None] * np.array([1.0, 0.0, 0.0])
        return LAYOUT.join(gripper[None], points)

    def random_obstacles(self, state: np.ndarray, rng: np.random.Generator) -> tuple[Obstacle, ...]:
        while True:
            box = Box((0.2, 0.2, 0.2), (*map(float, rng.uniform(-0.8, 0.8, 2)), 0.0))
            if box_distance([box], state.reshape(-1, 3)).min() > 0.02:
                return (Obstacle("cube", (box,)),)

    def rearrange(
        self, states: np.ndarray, rngs: Sequence[np.random.Generator], threads: int = 1
    ) -> tuple[list[tuple[Obstacle, ...]], np.ndarray]:
        return [self.random_obstacles(state, rng) for state, rng in zip(states, rngs, strict=True)], states

    def random_scene(self, rng: np.random.Generator, name: str) -> Scene:
        state = self.random_start(rng)
        points = tuple(tuple(map(float, point)) for point in LAYOUT.points_of(state))
        goal = point_goal(LAYOUT, "tail", (*rng.uniform(-0.7, 0.7, 2), 0.0), 0.05)
        return Scene(name, self.random_obstacles(state, rng), {"gripper": tuple(map(float, state[:3]))}, points, goal)
