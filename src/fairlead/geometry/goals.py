"""Goals, and how a scene file writes each: points at places, the rope inside or outside a box, all of several, any.

A new kind is a class here that implements `SceneGoal`, and a row in `KINDS`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, ClassVar, final

import numpy as np
from jaxtyping import Float

from fairlead.core.errors import UnknownNameError
from fairlead.core.layout import StateLayout
from fairlead.core.reading import Reader, Vector
from fairlead.core.roles import Goal
from fairlead.geometry.shapes import Box, box_distance

States = Float[np.ndarray, "batch state"]
MARGIN = 0.01
"""Samples keep this share of a box's half sides away from its faces."""


class SceneGoal(Goal):
    """A goal that a scene file can hold."""

    @classmethod
    @abstractmethod
    def read(cls, layout: StateLayout, reader: Reader) -> SceneGoal:
        """The goal that a file writes; FileFormatError names a wrong field, and what was allowed."""

    @abstractmethod
    def written(self) -> dict[str, Any]:
        """The JSON value that `read` reads. Pictures draw its `places`, `box` or `goals` (see core.marks)."""


@final
@dataclass(frozen=True)
class PointsGoal(SceneGoal):
    """Points of the object, or grippers, each at its place: kind `point` for one of them, `points` for several.

    The error is the largest distance of a point from its place.

    Args:
        layout: how to read a state.
        places: pairs of a point (see `StateLayout.index`) and where it must be [m]; no point twice.
        radius: how near is near enough [m].
    """

    layout: StateLayout
    places: tuple[tuple[str | int, Vector], ...]
    radius: float

    @classmethod
    def read(cls, layout: StateLayout, reader: Reader) -> SceneGoal:
        several = reader.value.get("kind") == "points"
        reader.only("kind", "radius", *(("places",) if several else ("target", "position")))
        each = [place.only("target", "position") for place in reader.some("places")] if several else [reader]
        places: dict[int, tuple[str | int, Vector]] = {}
        for place in each:
            target = place.get("target", object)
            if not isinstance(target, str | int):
                raise place.fail("target", f"the name or the number of a point is needed, got {type(target).__name__}")
            try:
                index = layout.index(target)
            except UnknownNameError as error:
                raise place.fail("target", str(error)) from None
            if index in places:
                raise place.fail("target", f"'{target}' has a place already; a point has one")
            places[index] = target, place.vector("position")
        return cls(layout, tuple(places.values()), reader.positive("radius"))

    def written(self) -> dict[str, Any]:
        places = [{"target": target, "position": position} for target, position in self.places]
        one = len(places) == 1
        return {**(places[0] if one else {"kind": "points", "places": places}), "radius": self.radius}

    @property
    def tolerance(self) -> float:
        return self.radius

    @cached_property
    def _indices(self) -> list[int]:
        return [self.layout.index(target) for target, _ in self.places]

    def _gaps(self, states: Float[np.ndarray, "*batch state"]) -> Float[np.ndarray, "*batch place 3"]:
        points = states.reshape(*states.shape[:-1], -1, 3)
        return np.array([position for _, position in self.places]) - points[..., self._indices, :]

    def error(self, states: Float[np.ndarray, "*batch state"]) -> Float[np.ndarray, "*batch"]:
        return np.asarray(np.linalg.norm(self._gaps(states), axis=-1).max(axis=-1))

    @cached_property
    def _weights(self) -> Float[np.ndarray, "point place"]:
        """How much of each place's shift a point of the state takes: linear between places along the rope.

        Along the rope come the grippers but the last, the rope from its tail on, the last gripper.
        """
        first = len(self.layout.grippers) - 1
        along = np.r_[-first:0, self.layout.points, : self.layout.points].astype(float)
        order = np.argsort(along[self._indices])
        at, share = along[self._indices][order], np.eye(len(order))[:, order]
        columns: list[np.ndarray] = [np.interp(along, at, share[k]) for k in range(len(order))]
        return np.stack(columns, axis=1)

    def sample(self, states: States, rng: np.random.Generator) -> States:
        """Shift the points to their places, and what lies between two by what lies between their shifts."""
        return states + (self._weights @ self._gaps(states)).reshape(states.shape)


def point_goal(layout: StateLayout, target: str | int, position: Iterable[float], radius: float) -> PointsGoal:
    """One point at a place [m], within a radius [m]: the paper's goals."""
    return PointsGoal(layout, ((target, tuple(map(float, position))),), radius)


@dataclass(frozen=True)
class BoxGoal(SceneGoal):
    """The whole object on one side of a box's faces."""

    layout: StateLayout
    box: Box
    kind: ClassVar[str]

    @classmethod
    def read(cls, layout: StateLayout, reader: Reader) -> SceneGoal:
        return cls(layout, Box.read(reader.only("kind", "box").object("box")))

    def written(self) -> dict[str, Any]:
        return {"kind": self.kind, "box": asdict(self.box)}

    @property
    def tolerance(self) -> float:
        return 0.0


@final
class InsideGoal(BoxGoal):
    """The whole object inside a box. The error is how far the farthest of its points is outside of it."""

    kind = "inside"

    def error(self, states: Float[np.ndarray, "*batch state"]) -> Float[np.ndarray, "*batch"]:
        return np.asarray(np.maximum(box_distance([self.box], self.layout.object_of(states)).max(axis=-1), 0.0))

    def sample(self, states: States, rng: np.random.Generator) -> States:
        """Put each state anywhere in the box, made narrower along the sides that it does not fit between."""
        rotation, half = self.box.rotation, (1 - MARGIN) * np.array(self.box.size) / 2
        rope = self.layout.object_of(states) @ rotation
        low, high = rope.min(axis=1, keepdims=True), rope.max(axis=1, keepdims=True)
        scale = np.minimum(1.0, 2 * half / np.maximum(high - low, 1e-9))
        slack = half - scale * (high - low) / 2
        centre = np.array(self.box.position) @ rotation + slack * rng.uniform(-1.0, 1.0, (len(states), 1, 3))
        points = (states.reshape(len(states), -1, 3) @ rotation - (low + high) / 2) * scale + centre
        return (points @ rotation.T).reshape(states.shape)


@final
class OutsideGoal(BoxGoal):
    """The whole object outside a box. The error is how deep the deepest of its points is inside of it."""

    kind = "outside"

    def error(self, states: Float[np.ndarray, "*batch state"]) -> Float[np.ndarray, "*batch"]:
        return np.asarray(np.maximum(-box_distance([self.box], self.layout.object_of(states)).min(axis=-1), 0.0))

    def sample(self, states: States, rng: np.random.Generator) -> States:
        """Shift a state that is in the box out through the face that takes the shortest way."""
        rotation, half, rows = self.box.rotation, (1 + MARGIN) * np.array(self.box.size) / 2, np.arange(len(states))
        rope = (self.layout.object_of(states) - self.box.position) @ rotation
        ways = np.concatenate([half - rope.min(axis=1), -half - rope.max(axis=1)], axis=1)
        face = np.abs(ways).argmin(axis=1)
        shift = ways[rows, face, None] * rotation.T[face % 3]
        return np.where(self.reached(states)[:, None], states, states + np.tile(shift, states.shape[1] // 3))


@dataclass(frozen=True)
class CombinedGoal(SceneGoal):
    """Several goals as one. Its error is made of excesses: the error of each goal beyond its own tolerance."""

    goals: tuple[SceneGoal, ...]
    kind: ClassVar[str]

    @classmethod
    def read(cls, layout: StateLayout, reader: Reader) -> SceneGoal:
        return cls(tuple(read_goal(layout, part) for part in reader.only("kind", "goals").some("goals")))

    def written(self) -> dict[str, Any]:
        return {"kind": self.kind, "goals": [goal.written() for goal in self.goals]}

    @property
    def tolerance(self) -> float:
        return 0.0

    def excesses(self, states: Float[np.ndarray, "*batch state"]) -> Float[np.ndarray, "*batch goal"]:
        """How far each goal is from being reached [m]."""
        return np.stack([np.maximum(goal.error(states) - goal.tolerance, 0.0) for goal in self.goals], axis=-1)


@final
class AllGoal(CombinedGoal):
    """All of several goals at once. The error is the largest excess."""

    kind = "all"

    def error(self, states: Float[np.ndarray, "*batch state"]) -> Float[np.ndarray, "*batch"]:
        return np.asarray(self.excesses(states).max(axis=-1))

    def sample(self, states: States, rng: np.random.Generator) -> States:
        """Samples of one goal after the other, in turns, as alternating projections; the nearest of all is taken."""
        best = states
        for goal in 4 * self.goals:
            states = np.where(goal.reached(states)[:, None], states, goal.sample(states, rng))
            best = np.where((self.error(states) < self.error(best))[:, None], states, best)
        return best


@final
class AnyGoal(CombinedGoal):
    """Any of several goals. The error is the smallest excess."""

    kind = "any"

    def error(self, states: Float[np.ndarray, "*batch state"]) -> Float[np.ndarray, "*batch"]:
        return np.asarray(self.excesses(states).min(axis=-1))

    def sample(self, states: States, rng: np.random.Generator) -> States:
        """A sample of one of the goals, drawn for each state, unless that is farther away."""
        drawn = np.stack([goal.sample(states, rng) for goal in self.goals])
        chosen = drawn[rng.integers(len(self.goals), size=len(states)), np.arange(len(states))]
        return np.where((self.error(chosen) <= self.error(states))[:, None], chosen, states)


KINDS: dict[str, type[SceneGoal]] = {
    "point": PointsGoal, "points": PointsGoal, **{of.kind: of for of in (InsideGoal, OutsideGoal, AllGoal, AnyGoal)}
}  # fmt: skip
"""What a scene file may write as a goal's `kind`; without one it is `point`."""


def read_goal(layout: StateLayout, reader: Reader) -> SceneGoal:
    """The goal of a scene file.

    Raises:
        FileFormatError: names the file, the wrong field, and what was allowed.
    """
    kind = reader.get("kind", str, "point")
    if kind not in KINDS:
        raise reader.fail("kind", str(UnknownNameError("goal", kind, KINDS)))
    return KINDS[kind].read(layout, reader)
