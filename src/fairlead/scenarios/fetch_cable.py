"""Fetching a charging cable (paper, Fig. 2 C): its end lies behind an obstacle and is dragged to the phone.

The gripper holds the cable's other end, before the obstacle. A phone, a mug, a stack of books and a lamp stand about.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from fairlead.core.errors import FairleadError, SamplingError
from fairlead.geometry.goals import SceneGoal, point_goal
from fairlead.geometry.shapes import Box, Obstacle, box_distance, octagon
from fairlead.scenarios.dragging import LAYOUT, WALLS, Dragging
from fairlead.scenarios.dragging_hard import lay_along, turn
from fairlead.scenarios.obstacles import place_apart
from fairlead.scenarios.render import Colour
from fairlead.scenarios.task import TRIES, TaskSpec, clear

BLOCKER = Obstacle("printer", (Box((0.42, 0.16, 0.20), (0.0, 0.0, 0.10)), Box((0.30, 0.10, 0.05), (0.0, 0.0, 0.225))))
PHONE = (Obstacle("phone", (Box((0.16, 0.08, 0.03), (0.0, 0.0, 0.015)),)),
         Obstacle("screen", (Box((0.145, 0.07, 0.004), (0.0, 0.0, 0.032)),)))  # fmt: skip
CLUTTER = (
    Obstacle("mug", octagon(0.045, 0.10)),
    Obstacle("books", (Box((0.26, 0.19, 0.08), (0.0, 0.0, 0.0)),)),
    Obstacle("lamp", octagon(0.08, 0.04)),
    Obstacle("box", (Box((0.20, 0.20, 0.16), (0.0, 0.0, 0.0)),)),
)
COLOURS: dict[str, Colour] = {
    "printer": (0.45, 0.47, 0.52, 1.0), "phone": (0.10, 0.11, 0.13, 1.0), "screen": (0.35, 0.65, 0.95, 1.0),
    "mug": (0.80, 0.30, 0.25, 1.0), "books": (0.35, 0.50, 0.38, 1.0), "lamp": (0.85, 0.75, 0.45, 1.0),
    "box": (0.76, 0.62, 0.45, 1.0),
}  # fmt: skip


def _desk(rng: np.random.Generator) -> tuple[Obstacle, ...]:
    """A printer about the middle, a phone before it, and the rest where neither cable nor phone is in the way."""
    shift, yaw = np.append(rng.uniform(-0.12, 0.12, 2), 0.0), float(rng.uniform(-np.pi, np.pi))
    printer = BLOCKER.moved(shift, yaw)
    aside = np.append(turn(np.array([rng.uniform(-0.2, 0.2), -rng.uniform(0.38, 0.5)]), yaw), 0.0)
    turned = yaw + float(rng.uniform(-0.8, 0.8))
    phone = [part.moved(shift + aside, turned) for part in PHONE]
    keep = np.array([[x, y, 0.02] for x in np.linspace(-0.3, 0.3, 13) for y in np.linspace(-0.45, 0.18, 13)])
    keep[:, :2] = shift[:2] + turn(keep[:, :2], yaw)
    placed = place_apart(CLUTTER, -0.85, 0.85, keep, 0.03, rng, [*WALLS, *printer.boxes, *phone[0].boxes])
    return (printer, *phone, *placed)


def _around(
    world: Dragging, obstacles: Sequence[Sequence[Obstacle]], rngs: Sequence[np.random.Generator], threads: int
) -> Float[np.ndarray, "batch state"]:
    """The gripper before the printer or at its side, the cable around a corner, its end behind the printer."""
    states = []
    for row, rng in zip(obstacles, rngs, strict=True):
        printer, side, gap = row[0].boxes[0], rng.choice([-1.0, 1.0]), rng.uniform(0.03, 0.06)
        x, y = np.array(printer.size[:2]) / 2 + gap
        first = rng.uniform(-0.02, 0.08)
        path = np.array([[side * x, -y + 0.02], [side * x, y], [-side * x, y]])
        if first > 0:
            path = np.concatenate([[[side * (x - first), -y]], [[side * x, -y]], path[1:]])
        local = np.column_stack([path, np.zeros(len(path))])
        states.append(lay_along(world, (local @ printer.rotation.T + printer.position)[:, :2]))
    return world.simulate(obstacles, np.stack(states), threads).observe()


def _scattered(
    world: Dragging, obstacles: Sequence[Sequence[Obstacle]], rngs: Sequence[np.random.Generator], threads: int
) -> Float[np.ndarray, "batch state"]:
    """Anywhere, clear of everything."""
    del threads
    return np.stack([_free(world, row, rng) for row, rng in zip(obstacles, rngs, strict=True)])


def _free(world: Dragging, obstacles: Sequence[Obstacle], rng: np.random.Generator) -> Float[np.ndarray, " state"]:
    for _ in range(TRIES):
        state = world.random_start(rng)
        if clear(world, obstacles, state):
            return state
    raise SamplingError("place for the cable", TRIES, "use fewer obstacles")


def _plugged(world: Dragging, obstacles: tuple[Obstacle, ...], rng: np.random.Generator) -> SceneGoal:
    """The cable's end before the phone's port, on the middle of one of its short sides."""
    phone = obstacles[1].boxes[0]
    out = rng.choice([-1.0, 1.0]) * (phone.size[0] / 2 + 0.04)
    place = np.append((phone.position + out * phone.rotation[:, 0])[:2], world.rope.height).round(4)
    if box_distance([*WALLS, *(box for o in obstacles for box in o.boxes)], place) < 0.035:
        raise FairleadError("the phone's port is blocked")
    return point_goal(LAYOUT, "tail", place, 0.05)


FETCH_CABLE = TaskSpec("fetch_cable", Dragging, _desk, _around, _scattered, _plugged, COLOURS)
