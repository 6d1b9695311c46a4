"""Errors that a user can cause, each a sentence that names what was wrong and what was allowed."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path


class FairleadError(Exception):
    """A mistake in what Fairlead was given. The command line prints it as one line and exits with 2."""


class UnknownNameError(FairleadError):
    """A name that is not in a table: a method, a scenario, a network, a scene."""

    def __init__(self, kind: str, name: str, allowed: Iterable[str]) -> None:
        names = sorted(allowed)
        close = difflib.get_close_matches(name, names, n=1)
        hint = f" (did you mean '{close[0]}'?)" if close else ""
        super().__init__(f"unknown {kind} '{name}'{hint}; allowed: {', '.join(names)}")


class FileFormatError(FairleadError):
    """A file whose content is not what its format asks for."""

    def __init__(self, path: Path | str, key: str, problem: str) -> None:
        where = f"{path}: {key}" if key else f"{path}"
        super().__init__(f"{where}: {problem}")


class ArtifactError(FairleadError):
    """A folder that is not the artifact that a stage needs: no manifest, another schema, a changed file."""

    def __init__(self, path: Path | str, problem: str) -> None:
        super().__init__(f"{path}: {problem}")


class SamplingError(FairleadError):
    """Rejection sampling that gave up; says what to change."""

    def __init__(self, what: str, tries: int, remedy: str) -> None:
        super().__init__(f"no {what} found in {tries} tries; {remedy}")
