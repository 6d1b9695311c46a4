"""What a part answers, looked at where it is used: a part of a user's own that errs is told in a sentence."""

from __future__ import annotations

from typing import Any

import numpy as np

from fairlead.core.errors import FairleadError


def expect(who: object, what: str, value: Any, shape: tuple[int, ...]) -> None:
    """FairleadError, which names the class of `who`, where `value` is no array of that shape."""
    found: Any = getattr(value, "shape", None)
    if found != shape:
        what_it_is = type(value).__name__ if found is None else found
        raise FairleadError(f"{type(who).__name__}: {what} must be an array of shape {shape}, not {what_it_is}")


def expect_finite(who: object, what: str, value: Any, shape: tuple[int, ...]) -> None:
    """As `expect`; and every number must be finite."""
    expect(who, what, value, shape)
    if not np.isfinite(value).all():
        raise FairleadError(f"{type(who).__name__}: {what} must be finite")


def expect_kind(name: str, value: Any, kind: type) -> None:
    """FairleadError where what was built under a name is not of that role."""
    if not isinstance(value, kind):
        raise FairleadError(f"{name} is a {type(value).__name__}; a {kind.__name__} is needed")
