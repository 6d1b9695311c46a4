"""Scene files: what is written can be read, and each mistake is one sentence that names the field."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fairlead.core.errors import FairleadError, FileFormatError
from fairlead.core.streams import stream
from fairlead.evaluation.shipped import benchmark_scenes
from fairlead.scenarios.dragging import Dragging
from fairlead.scenarios.dragging_hard import KINDS, hard_scene
from fairlead.scenarios.scene_files import write_scenes

DRAGGING = Dragging()
VALID: dict[str, Any] = json.loads(benchmark_scenes("dragging").read_text())
VALID["scenes"] = VALID["scenes"][:1]
INSIDE = [*VALID["scenes"][0]["obstacles"][0]["boxes"][0]["position"][:2], 0.02]


def _paths(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every place in a JSON value, but for what the reader does not need."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    below = [(*path, key) for key, _ in items if key not in ("units", "source")]
    return below + [deeper for place in below for deeper in _paths(_at(VALID, place), place)]


def _at(value: Any, path: tuple[Any, ...]) -> Any:
    for key in path:
        value = value[key]
    return value


def _read(tmp_path: Path, value: Any):
    file = tmp_path / "scenes.json"
    file.write_text(json.dumps(value))
    return DRAGGING.scenes(file)


def _mistake(folder: Path, value: Any) -> str:
    """What a user is told; nothing where the file is fine. Any other error than a user's mistake is raised."""
    try:
        _read(folder, value)
    except FairleadError as error:
        return str(error)
    return ""


def test_scenes_survive_the_round_trip(tmp_path: Path) -> None:
    scenes = DRAGGING.scenes(benchmark_scenes("dragging")).scenes
    write_scenes(tmp_path / "copy.json", "dragging", scenes, "a copy")
    assert DRAGGING.scenes(tmp_path / "copy.json").scenes == scenes


@given(st.sampled_from(_paths(VALID)), st.sampled_from([None, "x", -1.5, float("nan"), [], {}, True]))
def test_any_damaged_field_is_named_or_harmless(path: tuple[Any, ...], junk: Any) -> None:
    value = copy.deepcopy(VALID)
    parent = _at(value, path[:-1])
    parent[path[-1]] = junk
    with TemporaryDirectory() as folder:
        said = _mistake(Path(folder), value)
    assert "\n" not in said


@pytest.mark.parametrize(
    ("path", "junk", "names"),
    [
        (("scenes", 0, "obstacles", 2, "boxes", 0, "size"), [0.25, -0.25, 0.25], r"boxes\[0\]\.size.*positive"),
        (("scenes", 0, "rope", 3, 1), float("nan"), r"scenes\[0\]\.rope\[3\].*finite"),
        (("scenes", 0, "goal", "position"), INSIDE, "goal.position lies inside"),
        (("scenes", 0, "goal", "position"), [0.99, 0.0, 0.02], r"goal.position lies outside the bounds, \[-0.95, "),
        (("scenes", 0, "goal", "target"), "tial", r"goal\.target: unknown point 'tial' .did you mean 'tail'"),
        (("scenes", 0, "goal", "radius"), "wide", "goal.radius.*finite number"),
        (("scenes", 0, "grippers"), [], "grippers: an object is needed, got list"),
        (("scenario",), "dual_arm", "'dual_arm' scenes; 'dragging' scenes are needed"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, path: tuple[Any, ...], junk: Any, names: str) -> None:
    value = copy.deepcopy(VALID)
    _at(value, path[:-1])[path[-1]] = junk
    with pytest.raises(FairleadError, match=names):
        _read(tmp_path, value)


def test_a_scene_that_nobody_could_try_is_named_with_its_file(tmp_path: Path) -> None:
    path, dragging = tmp_path / "outside.json", Dragging()
    scenes = dragging.scenes(benchmark_scenes("dragging")).scenes[:2]
    out = replace(scenes[1], rope=tuple((x + 9.0, y, z) for x, y, z in scenes[1].rope))
    write_scenes(path, "dragging", [scenes[0], out], "a test")
    with pytest.raises(FileFormatError, match=r"outside\.json: scenes\[1\]: .*outside the arena"):
        dragging.scenes(path)


def test_a_missing_key_is_named_with_what_is_there(tmp_path: Path) -> None:
    value = copy.deepcopy(VALID)
    del value["scenes"][0]["goal"]["radius"]
    with pytest.raises(FileFormatError, match=r"scenes\[0\]\.goal\.radius: missing; found: position, target"):
        _read(tmp_path, value)


@pytest.mark.parametrize(
    ("path", "known"),
    [
        (("scenes", 0), "goal, grippers, name, obstacles, rope"),
        (("scenes", 0, "goal"), "kind, position, radius, target"),
        (("scenes", 0, "grippers"), "gripper"),
        (("scenes", 0, "obstacles", 2, "boxes", 0), "position, quaternion_xyzw, size"),
    ],
)
def test_a_key_that_means_nothing_is_named_with_the_known_ones(
    tmp_path: Path, path: tuple[Any, ...], known: str
) -> None:
    value = copy.deepcopy(VALID)
    _at(value, path)["raduis"] = 0.01
    with pytest.raises(FileFormatError, match=f"unknown key 'raduis'.*allowed: {known}$"):
        _read(tmp_path, value)


@pytest.mark.parametrize("kind", list(KINDS))
def test_hard_scenes_are_valid_and_depend_on_their_seed_alone(kind: str) -> None:
    first, second = (hard_scene(DRAGGING, kind, stream(5, kind), "hard") for _ in range(2))
    DRAGGING.validate(first)
    assert first == second
