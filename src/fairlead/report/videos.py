"""Which trials to show: the reference method beside the one without trust, a success, and a failure."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fairlead.core.marks import followed
from fairlead.core.traces import read_trace
from fairlead.report.playback import recording
from fairlead.report.sources import TrialSet
from fairlead.report.stage import SIDE, Cameras
from fairlead.report.video import Panel, write_gif, write_video

BASELINE = "accept-all"


@dataclass(frozen=True)
class Clip:
    """A video on the page, and the same as a moving GIF where there is one."""

    path: Path
    caption: str
    wide: bool
    gif: Path | None

    @property
    def uri(self) -> str:
        """The file as a data URI."""
        return "data:video/mp4;base64," + base64.b64encode(self.path.read_bytes()).decode()


@contextmanager
def panels(
    scenario: str, scene: Mapping[str, Any], traces: Mapping[str, Path], cameras: Cameras
) -> Iterator[list[Panel]]:
    """The parts of a video of trials in one scene (as a scene file writes it), from their traces by title."""
    with ExitStack() as opened:
        found = []
        for title, folder in traces.items():
            trace = read_trace(folder)
            points = followed(scene["goal"], trace.layout)
            camera = opened.enter_context(cameras(scenario, scene, SIDE))
            found.append(Panel(recording(trace, title, points), scene, points, camera))
        yield found


def traced(trials: TrialSet, method: str) -> dict[tuple[str, int], dict[str, Any]]:
    """The rows of a method whose traces were kept, by scene and seed."""
    rows = trials.rows_of.get(method, [])
    return {(r["scene"], r["seed"]): r for r in rows if trials.trace(method, r["scene"], r["seed"])}


def choose(trials: TrialSet) -> list[tuple[str, list[str], tuple[str, int]]]:
    """Captions, methods and (scene, seed) of the videos.

    The reference beside `accept-all`, on the first scene where only the reference succeeds (else on any), and a failure
    of the reference.
    """
    method = trials.reference
    ours, theirs = traced(trials, method), traced(trials, BASELINE)
    both = [key for key in ours if key in theirs and method != BASELINE]
    chosen: list[tuple[str, list[str], tuple[str, int]]] = []
    told = [key for key in both if ours[key]["success"] and not theirs[key]["success"]]
    if both:
        key = (told or both)[0]
        why = "the first kept trial where only one of them succeeds" if told else "the first kept trial"
        chosen.append((f"{method} beside {BASELINE} on {key[0]}: {why}.", [method, BASELINE], key))
    else:
        chosen += [(f"A success of {method} on {key[0]}.", [method], key) for key in ours if ours[key]["success"]][:1]
    shown = {key for _, _, key in chosen}
    failures = [key for key in ours if not ours[key]["success"] and key not in shown]
    chosen += [(f"A failure of {method} on {key[0]}.", [method], key) for key in failures[:1]]
    return chosen


def make_videos(trials: TrialSet, folder: Path, cameras: Cameras) -> list[Clip]:
    """Write the videos of a set of trials, and a moving GIF of the first."""
    scenes = {scene["name"]: scene for scene in trials.scenes}
    clips = []
    for number, (caption, methods, (scene, seed)) in enumerate(choose(trials)):
        traces = {method: trials.folder / "traces" / method / f"{scene}-{seed}" for method in methods}
        path = folder / f"{trials.folder.name}-{number}.mp4"
        with panels(trials.config["scenario"], scenes[scene], traces, cameras) as side_by_side:
            write_video(path, side_by_side)
        gif = path.with_suffix(".gif") if number == 0 else None
        if gif is not None:
            write_gif(path, gif)
        clips.append(Clip(path, caption, len(methods) > 1, gif))
    return clips
