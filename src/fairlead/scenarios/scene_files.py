"""Scene files: JSON with the obstacles, the start of the rope and the goal of each scene, validated field by field."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fairlead.core.artifacts import read_json, write_atomic
from fairlead.core.errors import FileFormatError, UnknownNameError
from fairlead.core.layout import StateLayout
from fairlead.geometry.shapes import Box, Obstacle

Vector = tuple[float, ...]
_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]*")
_JSON_NAMES = {dict: "an object", list: "a list", str: "a string"}


@dataclass(frozen=True)
class GoalSpec:
    """A goal as a scene file writes it: a named point of the rope, where it must be [m], how near [m]."""

    target: str
    position: Vector
    radius: float


@dataclass(frozen=True)
class Scene:
    """One scene. rope holds the link centres [m] from the tail (or the left gripper) on."""

    name: str
    obstacles: tuple[Obstacle, ...]
    grippers: Mapping[str, Vector]
    rope: tuple[Vector, ...]
    goal: GoalSpec

    def state(self, layout: StateLayout) -> np.ndarray:
        """The given start as a state vector (state,) [m]."""
        grippers = np.array([self.grippers[name] for name in layout.grippers])
        return layout.join(grippers, np.array(self.rope))


@dataclass(frozen=True)
class SceneSet:
    """The scenes of one file; `name` is the file's stem."""

    name: str
    scenario: str
    scenes: tuple[Scene, ...]

    def scene(self, name: str) -> Scene:
        """The scene of that name, or an UnknownNameError."""
        for scene in self.scenes:
            if scene.name == name:
                return scene
        raise UnknownNameError("scene", name, [scene.name for scene in self.scenes])


class _Reader:
    """Reads fields of a JSON value and says where a wrong one is."""

    def __init__(self, path: Path, value: Any, where: str = "") -> None:
        self.path, self.value, self.where = path, value, where

    def fail(self, key: str, problem: str) -> FileFormatError:
        return FileFormatError(self.path, ".".join(part for part in (self.where, key) if part), problem)

    def get(self, key: str, kind: type) -> Any:
        if not isinstance(self.value, dict):
            raise self.fail("", f"an object is needed, got {type(self.value).__name__}")
        if key not in self.value:
            raise self.fail(key, f"missing; found: {', '.join(sorted(self.value)) or 'nothing'}")
        found = self.value[key]
        if not isinstance(found, kind):
            raise self.fail(key, f"{_JSON_NAMES[kind]} is needed, got {type(found).__name__}")
        return found

    def child(self, key: str, value: Any) -> _Reader:
        return _Reader(self.path, value, f"{self.where}.{key}" if self.where else key)

    def items(self, key: str) -> list[_Reader]:
        return [self.child(f"{key}[{i}]", item) for i, item in enumerate(self.get(key, list))]

    def vector(self, key: str, length: int = 3) -> Vector:
        return self.as_vector(key, self.get(key, list), length)

    def as_vector(self, key: str, value: Any, length: int = 3) -> Vector:
        numbers = isinstance(value, list) and all(isinstance(v, int | float) and not isinstance(v, bool) for v in value)
        if not numbers or len(value) != length or not np.isfinite(value).all():
            raise self.fail(key, f"{length} finite numbers are needed, got {json.dumps(value)[:60]}")
        return tuple(map(float, value))


def _read_box(reader: _Reader) -> Box:
    fields = {key: reader.vector(key, n) for key, n in (("size", 3), ("position", 3), ("quaternion_xyzw", 4))}
    try:
        return Box(**fields)
    except ValueError as error:
        key, _, problem = str(error).partition(": ")
        raise reader.fail(key, problem) from None


def _read_obstacle(reader: _Reader) -> Obstacle:
    name = reader.get("name", str)
    boxes = tuple(_read_box(box) for box in reader.items("boxes"))
    if not boxes:
        raise reader.fail("boxes", "at least one box is needed")
    return Obstacle(name, boxes)


def _read_goal(reader: _Reader) -> GoalSpec:
    (radius,) = reader.as_vector("radius", [reader.get("radius", object)], 1)
    if radius <= 0:
        raise reader.fail("radius", f"a positive number of metres is needed, got {radius}")
    return GoalSpec(reader.get("target", str), reader.vector("position"), radius)


def _read_scene(reader: _Reader, layout: StateLayout) -> Scene:
    grippers = reader.child("grippers", reader.get("grippers", dict))
    rope = reader.get("rope", list)
    if len(rope) != layout.points:
        raise reader.fail("rope", f"{layout.points} points are needed, got {len(rope)}")
    return Scene(
        name=reader.get("name", str),
        obstacles=tuple(_read_obstacle(item) for item in reader.items("obstacles")),
        grippers={name: grippers.vector(name) for name in layout.grippers},
        rope=tuple(reader.as_vector(f"rope[{i}]", point) for i, point in enumerate(rope)),
        goal=_read_goal(reader.child("goal", reader.get("goal", dict))),
    )


def read_scenes(path: Path, scenario: str, layout: StateLayout) -> SceneSet:
    """Read and validate a scene file of `scenario`.

    Raises:
        ArtifactError: the file is missing or not JSON.
        FileFormatError: a field is missing or wrong; names the file, the field and what was allowed.
    """
    reader = _Reader(path, read_json(path))
    found = reader.get("scenario", str)
    if found != scenario:
        raise reader.fail("scenario", f"'{found}' scenes; '{scenario}' scenes are needed here")
    scenes = tuple(_read_scene(item, layout) for item in reader.items("scenes"))
    if not scenes:
        raise reader.fail("scenes", "at least one scene is needed")
    names = [scene.name for scene in scenes]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise reader.fail(f"scenes[{i}].name", f"'{name}' is used twice")
        if not _NAME.fullmatch(name):
            raise reader.fail(f"scenes[{i}].name", f"letters, digits, '-', '_' and '.' are allowed, got '{name}'")
    return SceneSet(path.stem, scenario, scenes)


def write_scenes(path: Path, scenario: str, scenes: Sequence[Scene], source: str) -> None:
    """Write scenes in the format that `read_scenes` reads; `source` says where they come from."""
    write_atomic(
        path,
        json.dumps(
            {
                "scenario": scenario,
                "units": "metres, unit quaternions (x, y, z, w), world frame",
                "source": source,
                "scenes": [asdict(scene) for scene in scenes],
            }
        )
        + "\n",
    )
