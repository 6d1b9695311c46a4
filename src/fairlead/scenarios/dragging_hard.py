"""Hard dragging scenes: narrow gaps, wrapped and wedged starts, goals inside and behind corners.

Each kind is a function from a random stream to obstacles, a start and a goal position. Whether a scene can be solved
is for the oracle to show, not for this file.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from fairlead.core.errors import SamplingError
from fairlead.geometry.goals import point_goal
from fairlead.geometry.shapes import Obstacle, box_distance
from fairlead.scenarios.dragging import CORNER, CUBE, LAYOUT, OBSTACLES, WALLS, Dragging
from fairlead.scenarios.obstacles import place_apart
from fairlead.scenarios.scene_files import Scene

Draft = tuple[tuple[Obstacle, ...], np.ndarray, np.ndarray]
"""Obstacles, start state, goal position."""


def on_floor(shape: Obstacle, name: str, position: tuple[float, float], yaw: float) -> Obstacle:
    """A named copy of a shape standing on the floor."""
    return Obstacle(name, shape.moved((*position, shape.boxes[0].size[2] / 2), yaw).boxes)


def _rest(
    names: tuple[str, ...], fixed: dict[str, Obstacle], clear: np.ndarray, rng: np.random.Generator
) -> tuple[Obstacle, ...]:
    """`fixed` obstacles and the others at random places apart from them, all in the usual order."""
    shapes = [obstacle for obstacle in OBSTACLES if obstacle.name in names]
    taken = [*WALLS, *(box for obstacle in fixed.values() for box in obstacle.boxes)]
    found = {o.name: o for o in place_apart(shapes, -0.85, 0.85, clear, 0.06, rng, taken)} | fixed
    return tuple(found[obstacle.name] for obstacle in OBSTACLES)


def _others(fixed: dict[str, Obstacle]) -> tuple[str, ...]:
    return tuple(obstacle.name for obstacle in OBSTACLES if obstacle.name not in fixed)


def lay_along(scenario: Dragging, path: Float[np.ndarray, "corner 2"]) -> Float[np.ndarray, " state"]:
    """A rope along a polyline of gripper-to-tail positions [m], the gripper at its beginning."""
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    length = np.r_[0, np.cumsum(steps)]
    rope = scenario.rope
    at = rope.grip_offset + rope.link_length * np.arange(rope.links)[::-1]
    state = np.full(LAYOUT.state_size, rope.height)
    state[:2] = path[0]
    points = LAYOUT.points_of(state)
    points[:, 0], points[:, 1] = np.interp(at, length, path[:, 0]), np.interp(at, length, path[:, 1])
    return state


def turn(points: Float[np.ndarray, "*batch 2"], yaw: float) -> Float[np.ndarray, "*batch 2"]:
    """Points [m] turned about the origin by an angle [rad]."""
    return points @ np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])


def gap(scenario: Dragging, rng: np.random.Generator) -> Draft:
    """A barrier across the arena with one gap of 8 to 15 cm; the goal is on the other side."""
    width, line, yaw = rng.uniform(0.08, 0.15), rng.uniform(-0.15, 0.15), rng.integers(4) * np.pi / 2
    order = rng.permutation([0.25] * 5 + [0.5])
    place = rng.integers(1, 6)
    slack = (1.9 - order.sum() - width) / 6
    fixed: dict[str, Obstacle] = {}
    x, cubes = -0.95 + slack / 2, iter(range(1, 6))
    for i, size in enumerate(order):
        x += width if i == place else slack if i else 0.0
        centre = tuple(turn(np.array([x + size / 2, line]), yaw))
        name = f"box{next(cubes)}" if size == 0.25 else "corner1"
        fixed[name] = on_floor(CUBE if size == 0.25 else CORNER, name, centre, float(yaw))
        x += size
    side = rng.choice([-1.0, 1.0])
    start_y = line + side * rng.uniform(0.35, 0.5)
    x0 = rng.uniform(-0.7, 0.1)
    ends = np.array([[x0, start_y], [x0 + 0.5, start_y]])
    state = lay_along(scenario, turn(ends[:: rng.choice([-1, 1])], yaw))
    goal = turn(np.array([rng.uniform(-0.6, 0.6), line - side * rng.uniform(0.35, 0.55)]), yaw)
    clear = np.concatenate([state.reshape(-1, 3), [[*goal, 0.02]]])
    return _rest(_others(fixed), fixed, clear, rng), state, goal


def wrapped(scenario: Dragging, rng: np.random.Generator) -> Draft:
    """The rope starts around a cube, in contact with two or three of its sides."""
    centre, yaw = rng.uniform(-0.45, 0.45, 2), rng.uniform(-np.pi, np.pi)
    d = 0.125 + 0.024
    first = rng.uniform(0.02, 0.14)
    ring = np.array([[d - first, -d], [d, -d], [d, d], [-d, d], [-d, -d]])
    if rng.random() < 0.5:
        ring[:, 1] *= -1
    fixed = {"box1": on_floor(CUBE, "box1", tuple(centre), float(yaw))}
    state = lay_along(scenario, centre + turn(ring, yaw))
    goal = rng.uniform(-0.7, 0.7, 2)
    clear = np.concatenate([state.reshape(-1, 3), [[*goal, 0.02]]])
    return _rest(_others(fixed), fixed, clear, rng), state, goal


def wedged(scenario: Dragging, rng: np.random.Generator) -> Draft:
    """The rope starts folded into the angle of an L-shaped corner."""
    centre, yaw = rng.uniform(-0.5, 0.5, 2), rng.uniform(-np.pi, np.pi)
    inner = np.array([0.17 - 0.024, 0.04 + 0.024])
    path = inner + np.array([[-0.20, 0.06], [-0.22, 0.0], [0.0, 0.0], [0.0, 0.1], [-0.05, 0.2]])
    fixed = {"corner1": on_floor(CORNER, "corner1", tuple(centre), float(yaw))}
    state = lay_along(scenario, centre + turn(path[:: rng.choice([-1, 1])], yaw))
    goal = rng.uniform(-0.7, 0.7, 2)
    clear = np.concatenate([state.reshape(-1, 3), [[*goal, 0.02]]])
    return _rest(_others(fixed), fixed, clear, rng), state, goal


def _corner_goal(scenario: Dragging, rng: np.random.Generator, place: Float[np.ndarray, " 2"]) -> Draft:
    """A goal at `place` in the frame of an L-shaped corner, a random start elsewhere."""
    centre, yaw = rng.uniform(-0.55, 0.55, 2), rng.uniform(-np.pi, np.pi)
    goal = centre + turn(place, yaw)
    fixed = {"corner1": on_floor(CORNER, "corner1", tuple(centre), float(yaw))}
    state = scenario.random_start(rng)
    for _ in range(200):
        if box_distance(fixed["corner1"].boxes, state.reshape(-1, 3)).min() > 0.05:
            break
        state = scenario.random_start(rng)
    clear = np.concatenate([state.reshape(-1, 3), [[*goal, 0.02]]])
    return _rest(_others(fixed), fixed, clear, rng), state, goal


def goal_inside(scenario: Dragging, rng: np.random.Generator) -> Draft:
    """The goal lies in the angle of an L-shaped corner, 5 to 8 cm from both bars."""
    return _corner_goal(scenario, rng, np.array([0.17, 0.04]) + rng.uniform(0.05, 0.08) * np.array([-1.0, 1.0]))


def goal_behind(scenario: Dragging, rng: np.random.Generator) -> Draft:
    """The goal lies behind the outer edge of an L-shaped corner, 5 to 8 cm from it."""
    return _corner_goal(scenario, rng, np.array([rng.uniform(0.0, 0.25), -0.04 - rng.uniform(0.05, 0.08)]))


KINDS: dict[str, Callable[[Dragging, np.random.Generator], Draft]] = {
    "gap": gap, "wrapped": wrapped, "wedged": wedged, "goal-inside": goal_inside, "goal-behind": goal_behind,
}  # fmt: skip


def hard_scene(scenario: Dragging, kind: str, rng: np.random.Generator, name: str) -> Scene:
    """A scene of one of `KINDS`, settled; drafts that do not fit into the arena are drawn again.

    Raises:
        SamplingError: no draft fitted.
    """
    for _ in range(400):
        try:
            obstacles, state, goal = KINDS[kind](scenario, rng)
        except SamplingError:
            continue
        environment = scenario.environment(obstacles)
        fixed = [box for obstacle in obstacles for box in obstacle.boxes]
        corners = np.concatenate([box.corners() for box in fixed])
        position = np.array([*goal, scenario.rope.height])
        chain = state.reshape(-1, 3)
        inside = np.abs(corners[:, :2]).max() < 0.951 and np.abs(goal).max() < 0.85
        if not inside or environment.signed_distance(position) < 0.045:
            continue
        if environment.signed_distance(chain).min() < 0.012:
            continue
        settled = scenario.simulate([obstacles], state[None]).observe()[0].round(5)
        if environment.signed_distance(settled.reshape(-1, 3)).min() < 0.017:
            continue
        return Scene.starting(LAYOUT, name, obstacles, settled, point_goal(LAYOUT, "tail", position.round(5), 0.05))
    raise SamplingError(f"hard scene of kind '{kind}'", 400, "loosen its limits")
