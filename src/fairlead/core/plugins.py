"""Parts found by name: Fairlead's own, then those that other installed distributions offer.

A distribution offers a part by an entry point, in the group `fairlead.scenarios`, `fairlead.checks` or
`fairlead.planners`; nothing in Fairlead has to change for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from fairlead.core.errors import FairleadError, UnknownNameError

GROUPS = {"scenario": "fairlead.scenarios", "check": "fairlead.checks", "planner": "fairlead.planners"}
"""The kinds of parts that can be added from outside, and the entry-point group of each."""


def _offered(kind: str) -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=GROUPS[kind])}


def names(kind: str, own: Mapping[str, Any]) -> list[str]:
    """Every name of that kind, sorted: the keys of `own` and what entry points add."""
    return sorted({*own, *_offered(kind)})


def find(kind: str, name: str, own: Mapping[str, Any]) -> Any:
    """The part called `name`: from `own`, else from an entry point. Own names cannot be taken over.

    Raises:
        UnknownNameError: nobody offers that name.
        FairleadError: the distribution that offers it cannot be imported.
    """
    if name in own:
        return own[name]
    point = _offered(kind).get(name)
    if point is None:
        raise UnknownNameError(kind, name, names(kind, own))
    try:
        return point.load()
    except (ImportError, AttributeError) as error:
        raise FairleadError(f"{kind} '{name}' ({point.value}) cannot be loaded: {error}") from error
