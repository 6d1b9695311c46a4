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
from fairlead.core.errors import UnknownNameError
from fairlead.core.layout import StateLayout
from fairlead.core.reading import Reader, Vector
from fairlead.geometry.goals import SceneGoal, read_goal
from fairlead.geometry.shapes import Box, Obstacle

_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]*")


@dataclass(frozen=True)
class Scene:
    """One scene. rope holds the link centres [m] from the tail (or the left gripper) on."""

    name: str
    obstacles: tuple[Obstacle, ...]
    grippers: Mapping[str, Vector]
    rope: tuple[Vector, ...]
    goal: SceneGoal

    @classmethod
    def starting(
        cls, layout: StateLayout, name: str, obstacles: Sequence[Obstacle], state: np.ndarray, goal: SceneGoal
    ) -> Scene:
        """A scene that starts in a state (state,) [m], rounded to hundredths of a millimetre."""
        at, points = (of(state.round(5)).tolist() for of in (layout.grippers_of, layout.points_of))
        grippers = {gripper: tuple(place) for gripper, place in zip(layout.grippers, at, strict=True)}
        return cls(name, tuple(obstacles), grippers, tuple(map(tuple, points)), goal)

    def state(self, layout: StateLayout) -> np.ndarray:
        """The given start as a state vector (state,) [m]."""
        grippers = np.array([self.grippers[name] for name in layout.grippers])
        return layout.join(grippers, np.array(self.rope).reshape(-1, 3))

    def written(self) -> dict[str, Any]:
        """The JSON value that a scene file holds."""
        about = {"name": self.name, "obstacles": [asdict(obstacle) for obstacle in self.obstacles]}
        return {**about, "grippers": dict(self.grippers), "rope": self.rope, "goal": self.goal.written()}


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


def _read_obstacle(reader: Reader) -> Obstacle:
    name = reader.only("name", "boxes").get("name", str)
    return Obstacle(name, tuple(Box.read(box) for box in reader.some("boxes")))


def _read_scene(reader: Reader, layout: StateLayout) -> Scene:
    reader.only("name", "obstacles", "grippers", "rope", "goal")
    grippers = reader.object("grippers").only(*layout.grippers)
    rope = reader.get("rope", list)
    if len(rope) != layout.points:
        raise reader.fail("rope", f"{layout.points} points are needed, got {len(rope)}")
    return Scene(
        name=reader.get("name", str),
        obstacles=tuple(_read_obstacle(item) for item in reader.items("obstacles")),
        grippers={name: grippers.vector(name) for name in layout.grippers},
        rope=tuple(reader.as_vector(f"rope[{i}]", point) for i, point in enumerate(rope)),
        goal=read_goal(layout, reader.object("goal")),
    )


def read_scenes(path: Path, scenario: str, layout: StateLayout) -> SceneSet:
    """Read and validate a scene file of `scenario`.

    Raises:
        ArtifactError: the file is missing or not JSON.
        FileFormatError: a field is missing or wrong; names the file, the field and what was allowed.
    """
    reader = Reader(path, read_json(path))
    found = reader.get("scenario", str)
    if found != scenario:
        raise reader.fail("scenario", f"'{found}' scenes; '{scenario}' scenes are needed here")
    scenes = tuple(_read_scene(item, layout) for item in reader.some("scenes"))
    names = [scene.name for scene in scenes]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise reader.fail(f"scenes[{i}].name", f"'{name}' is used twice")
        if not _NAME.fullmatch(name):
            raise reader.fail(f"scenes[{i}].name", f"letters, digits, '-', '_' and '.' are allowed, got '{name}'")
    return SceneSet(path.stem, scenario, scenes)


def scene_from(value: Mapping[str, Any], layout: StateLayout) -> Scene:
    """The scene that `written` or a scene file has as `value`; FileFormatError where it is none."""
    return _read_scene(Reader(Path("scene"), json.loads(json.dumps(value))), layout)


def write_scenes(path: Path, scenario: str, scenes: Sequence[Scene], source: str) -> None:
    """Write scenes in the format that `read_scenes` reads; `source` says where they come from."""
    write_atomic(
        path,
        json.dumps(
            {
                "scenario": scenario,
                "units": "metres, unit quaternions (x, y, z, w), world frame",
                "source": source,
                "scenes": [scene.written() for scene in scenes],
            }
        )
        + "\n",
    )
