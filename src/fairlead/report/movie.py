"""A movie: cards with a few words, and trials between them, each no longer than one likes to watch."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image, ImageDraw

from fairlead.report.playback import FPS
from fairlead.report.sources import TrialSet
from fairlead.report.stage import SHARP, SIDE, Cameras
from fairlead.report.style import INK, MUTED, PAPER
from fairlead.report.video import FOOT, GAP, HEAD, LEGEND, font, frame, together, within, write_frames
from fairlead.report.videos import BASELINE, panels, traced

CAPTION = 46
WIDTH, HEIGHT = 2 * SIDE + 3 * GAP, CAPTION + HEAD + SIDE + FOOT + LEGEND
"""Pixels of the strip above a trial that says what one sees, and of the movie."""
LONGEST_S = 11
"""Seconds of the movie that a trial may take; a longer one plays faster."""


@dataclass(frozen=True)
class Card:
    """A few lines of text, shown for so many seconds [s]."""

    title: str
    lines: tuple[str, ...]
    seconds: float = 5.0


@dataclass(frozen=True)
class Take:
    """Trials in one scene, by the names of their methods: one, with `beside` next to it, or two."""

    trials: TrialSet
    scene: str
    seed: int
    methods: tuple[str, ...]
    caption: str
    beside: tuple[str, ...] = ()


def takes(trials: TrialSet, count: int) -> list[Take]:
    """The reference beside `accept-all` in so many scenes: first those where only the reference succeeds."""
    ours, theirs = traced(trials, trials.reference), traced(trials, BASELINE)
    ranks = {key: (not ours[key]["success"], theirs[key]["success"]) for key in ours if key in theirs}
    words = {
        (False, False): "only the left one reaches the goal",
        (False, True): "both reach the goal",
        (True, False): "neither reaches the goal",
        (True, True): "only the right one reaches the goal",
    }
    return [
        Take(trials, *key, (trials.reference, BASELINE), words[ranks[key]])
        for key in sorted(ranks, key=lambda key: ranks[key])[:count]
    ]


def recoveries(trials: TrialSet, beside: tuple[str, ...]) -> list[Take]:
    """One trial of the reference in which it was stuck and recovered, a successful one if there is any."""
    ours = traced(trials, trials.reference)
    found = sorted((key for key in ours if ours[key]["recovery_actions"]), key=lambda key: not ours[key]["success"])
    words = {True: "stuck; after recovery it reaches the goal", False: "stuck; recovery does not lead to the goal"}
    return [Take(trials, *key, (trials.reference,), words[ours[key]["success"]], beside) for key in found[:1]]


def write_movie(
    path: Path, parts: Sequence[Card | Take], cameras: Cameras, shown: Callable[[Card | Take], Any]
) -> None:
    """Write the movie, an MP4; `shown` is told each part that is done."""

    def frames() -> Iterator[Image.Image]:
        for part in parts:
            yield from _card(part) if isinstance(part, Card) else _take(part, cameras)
            shown(part)

    write_frames(path, frames())


def _write(image: Image.Image, at: tuple[int, int], lines: Sequence[str], size: int, colour: str = INK) -> None:
    """Lines of text, one below the other."""
    draw = ImageDraw.Draw(image)
    for number, line in enumerate(lines):
        place = at[0] * SHARP, (at[1] + round(1.7 * size * number)) * SHARP
        draw.text(place, line, font=font(size), fill=colour)


def _blank() -> Image.Image:
    return Image.new("RGB", (WIDTH * SHARP, HEIGHT * SHARP), PAPER)


def _sized(image: Image.Image) -> Image.Image:
    return image.resize((WIDTH, HEIGHT), Image.Resampling.BOX)


def _card(card: Card) -> Iterator[Image.Image]:
    image = _blank()
    left, top = 110, HEIGHT // 2 - 40 - 20 * len(card.lines)
    ImageDraw.Draw(image).text((left * SHARP, top * SHARP), card.title, font=font(44, bold=True), fill=INK)
    _write(image, (left, top + 90), card.lines, 22, MUTED)
    yield from [_sized(image)] * round(card.seconds * FPS)


def _take(take: Take, cameras: Cameras) -> Iterator[Image.Image]:
    scene = next(scene for scene in take.trials.scenes if scene["name"] == take.scene)
    traces = {method: take.trials.trace(method, take.scene, take.seed) for method in take.methods}
    blank = _blank()
    _write(blank, (GAP, 14), (f"{take.scene}: {take.caption}",), 18, MUTED)
    _write(blank, (SIDE + 3 * GAP, CAPTION + HEAD + 60), take.beside, 19)
    blank = _sized(blank)
    with panels(take.trials.config, scene, traces, cameras) as side_by_side:
        views, speed = within(together(side_by_side), LONGEST_S)
        for shown in views:
            image = blank.copy()
            image.paste(frame(side_by_side, shown, speed), (0, CAPTION))
            yield image
