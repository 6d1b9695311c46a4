"""Reads the fields of a JSON value, and says where a wrong one is and what was allowed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, cast, final

import numpy as np

from fairlead.core.errors import FileFormatError, UnknownNameError

Vector = tuple[float, ...]
_JSON_NAMES = {dict: "an object", list: "a list", str: "a string"}


@final
class Reader:
    """A value of a JSON file; `where` is the path of keys to it.

    Every method raises FileFormatError for a field that is missing or wrong.
    """

    def __init__(self, path: Path, value: Any, where: str = "") -> None:
        self.path, self.value, self.where = path, value, where

    def fail(self, key: str, problem: str) -> FileFormatError:
        """The error that names a field of this value."""
        return FileFormatError(self.path, ".".join(part for part in (self.where, key) if part), problem)

    def get(self, key: str, kind: type, default: Any = None) -> Any:
        """A field of a JSON type; `object` for any. A default is taken where the field is missing."""
        fields = cast(dict[str, Any], self.value)
        if not isinstance(self.value, dict):
            raise self.fail("", f"an object is needed, got {type(fields).__name__}")
        if key not in fields and default is not None:
            return default
        if key not in fields:
            raise self.fail(key, f"missing; found: {', '.join(sorted(fields)) or 'nothing'}")
        found = fields[key]
        if not isinstance(found, kind):
            raise self.fail(key, f"{_JSON_NAMES[kind]} is needed, got {type(found).__name__}")
        return found

    def only(self, *allowed: str) -> Reader:
        """This object, which has no other fields than these."""
        found: object = self.value
        keys = cast(dict[str, Any], found) if isinstance(found, dict) else ()
        for key in keys:
            if key not in allowed:
                raise self.fail("", str(UnknownNameError("key", key, allowed)))
        return self

    def child(self, key: str, value: Any) -> Reader:
        """A value below this one."""
        return Reader(self.path, value, f"{self.where}.{key}" if self.where else key)

    def object(self, key: str) -> Reader:
        """A field that holds an object."""
        return self.child(key, self.get(key, dict))

    def items(self, key: str) -> list[Reader]:
        """The items of a field that holds a list."""
        return [self.child(f"{key}[{i}]", item) for i, item in enumerate(self.get(key, list))]

    def some(self, key: str) -> list[Reader]:
        """The items of a field that holds a list of at least one."""
        if not self.get(key, list):
            raise self.fail(key, "at least one is needed")
        return self.items(key)

    def positive(self, key: str) -> float:
        """A positive number of metres."""
        (number,) = self.as_vector(key, [self.get(key, object)], 1)
        if number <= 0:
            raise self.fail(key, f"a positive number of metres is needed, got {number}")
        return number

    def vector(self, key: str, length: int = 3) -> Vector:
        """A field that holds so many finite numbers."""
        return self.as_vector(key, self.get(key, list), length)

    def as_vector(self, key: str, value: Any, length: int = 3) -> Vector:
        """A value of so many finite numbers; `key` is what to call it."""
        found = cast(list[Any], value) if isinstance(value, list) else []
        numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in found)
        if not numbers or len(found) != length or not np.isfinite(found).all():
            raise self.fail(key, f"{length} finite numbers are needed, got {json.dumps(value)[:60]}")
        return tuple(map(float, found))
