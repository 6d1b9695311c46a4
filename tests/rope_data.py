"""Synthetic data for learning: a planar rope that follows its gripper, among boxes that stop the gripper."""

from __future__ import annotations

import numpy as np

from fairlead.core.layout import StateLayout
from fairlead.core.records import Trajectories
from fairlead.geometry.fields import BoxEnvironment
from fairlead.geometry.shapes import Box
from fairlead.learning.rollout import Splits

LAYOUT = StateLayout(("gripper",), 5)
BOUNDS = np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 0.04]])
LINK = 0.05


def follow(states: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """The gripper goes to its target; each point is pulled to one link from the one before it."""
    out = states.reshape(len(states), -1, 3).copy()
    out[:, 0] = targets
    leader = out[:, 0]
    for point in range(LAYOUT.points, 0, -1):
        pulled = out[:, point] - leader
        out[:, point] = leader + LINK * pulled / np.maximum(np.linalg.norm(pulled, axis=-1, keepdims=True), 1e-9)
        leader = out[:, point]
    return out.reshape(states.shape)


def straight_ropes(count: int, rng: np.random.Generator) -> np.ndarray:
    """Straight ropes anywhere, in any direction."""
    yaw = rng.uniform(-np.pi, np.pi, count)
    direction = np.stack([np.cos(yaw), np.sin(yaw), np.zeros(count)], -1)
    gripper = np.concatenate([rng.uniform(-0.6, 0.6, (count, 2)), np.full((count, 1), 0.02)], -1)
    offsets = LINK * np.array([0, *range(LAYOUT.points, 0, -1)])
    return (gripper[:, None] + offsets[:, None] * direction[:, None]).reshape(count, -1)


def environments(count: int, rng: np.random.Generator) -> list[BoxEnvironment]:
    """Two cubes each, anywhere."""
    return [
        BoxEnvironment([Box((0.25, 0.25, 0.25), (*rng.uniform(-0.8, 0.8, 2), 0.125)) for _ in range(2)], BOUNDS)
        for _ in range(count)
    ]


def trajectories(count: int, steps: int, scenes: int, rng: np.random.Generator) -> Trajectories:
    """Random drags. A gripper target inside an obstacle is refused: the rope stays where it is."""
    worlds = environments(scenes, rng) if scenes else [BoxEnvironment([], BOUNDS)]
    scene = np.arange(count) % len(worlds)
    states, actions = [straight_ropes(count, rng)], []
    for _ in range(steps):
        yaw, reach = rng.uniform(-np.pi, np.pi, count), rng.uniform(0, 0.15, count)
        move = np.stack([reach * np.cos(yaw), reach * np.sin(yaw), np.zeros(count)], -1)
        target = states[-1][:, :3] + move
        free = np.array([not worlds[s].occupied(t) for s, t in zip(scene, target, strict=True)])
        actions.append(target)
        states.append(np.where(free[:, None], follow(states[-1], target), states[-1]))
    return Trajectories(LAYOUT, np.stack(states, 1), np.stack(actions, 1), np.zeros((count, steps), int), scene, worlds)


def splits(count: int, steps: int, scenes: int, seed: int = 0) -> Splits:
    """Independent training, validation and test data."""
    rng = np.random.default_rng(seed)
    return Splits(*(trajectories(n, steps, scenes, rng) for n in (count, count // 4, count // 4)))
