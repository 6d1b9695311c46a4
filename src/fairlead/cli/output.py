"""What commands print: results for people or, with --json, for machines; and progress on the error stream."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any


def show(result: Mapping[str, Any], as_json: bool) -> None:
    """Print a result: one JSON object on one line, or one `key: value` a line.

    Who reads may stop early, as `head` does.
    """
    lines = [json.dumps(result)] if as_json else _lines(result)
    try:
        print("".join(f"{line}\n" for line in lines), end="", flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _lines(result: Mapping[str, Any]) -> list[str]:
    width, lines = max(map(len, result), default=0), []
    for key, value in result.items():
        text = ", ".join(f"{k} {v}" for k, v in value.items()) if isinstance(value, Mapping) else str(value)
        lines.append(f"{key:<{width}}  {text}")
    return lines


@contextmanager
def progress_bar(label: str, total: float, unit: str) -> Iterator[Callable[[float], None]]:
    """A bar with rate and time left on the error stream. Yields the function to call with each advance."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        ProgressColumn,
        Task,
        TextColumn,
        TimeRemainingColumn,
    )
    from rich.text import Text

    class Rate(ProgressColumn):
        def render(self, task: Task) -> Text:
            return Text(f"{task.speed:,.0f} {unit}/s" if task.speed else f"- {unit}/s")

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), Rate(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as progress:
        task = progress.add_task(label, total=total)
        yield lambda count: progress.advance(task, count)
