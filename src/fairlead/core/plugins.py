"""Parts found by name: Fairlead's own, then those that other installed distributions offer.

A distribution offers a part by an entry point in one of these `GROUPS`; nothing in Fairlead has to change for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from fairlead.core.artifacts import sha256
from fairlead.core.errors import FairleadError, UnknownNameError

GROUPS = {
    "scenario": "fairlead.scenarios",
    "dynamics": "fairlead.dynamics",
    "check": "fairlead.checks",
    "recovery": "fairlead.recoveries",
    "method": "fairlead.methods",
    "planner": "fairlead.planners",
}
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
    except Exception as error:  # code of others runs here: any error of it is theirs
        problem = f"{type(error).__name__}: {error}"
        raise FairleadError(f"{kind} '{name}' ({point.value}) cannot be loaded: {problem}") from error


def fingerprint(kind: str, name: str, own: Mapping[str, Any]) -> str | None:
    """SHA-256 of the file that offers a part, None for our own: what was made with another version is of another kind.

    Of that file alone: what it imports is not looked at.
    """
    if name in own or (point := _offered(kind).get(name)) is None:
        return None
    found = find_spec(point.module)
    return sha256(Path(found.origin)) if found and found.origin else point.value
