"""What a goal looks like: the balls and boxes in it as a scene file writes it, whatever its kind, for pictures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fairlead.core.layout import StateLayout

Mark = Mapping[str, Any]
"""A ball (`position`, `radius`, and the `target` that must be there) or a box (`size`, `position`, `quaternion_xyzw`);
`kind` is that of the goal it is written in, `where` the path of keys to it."""


def marks(goal: Mapping[str, Any], where: str = "goal") -> list[Mark]:
    """The balls and boxes of a goal: in its `goals`, one by one, else its `places`, its `box`, or itself."""
    if "goals" in goal:
        return [mark for i, part in enumerate(goal["goals"]) for mark in marks(part, f"{where}.goals[{i}]")]
    if "places" in goal:
        shapes = {f"{where}.places[{i}]": place for i, place in enumerate(goal["places"])}
    else:
        shapes = {f"{where}.box": goal["box"]} if "box" in goal else {where: goal}
    about = {"kind": goal.get("kind", "point"), "radius": goal.get("radius", 0.0)}
    return [{**about, **shape, "where": place} for place, shape in shapes.items()]


def followed(goal: Mapping[str, Any], layout: StateLayout) -> tuple[int, ...]:
    """The rope points that a goal names, a gripper by the point it holds; the midpoint where it names none."""
    targets = [layout.index(mark["target"]) for mark in marks(goal) if "target" in mark]
    return tuple(dict.fromkeys(layout.held(target) for target in targets)) or (layout.points // 2,)
