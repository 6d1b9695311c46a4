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
from fairlead.report.playback import as_predicted, recording
from fairlead.report.sources import TrialSet
from fairlead.report.stage import SIDE, Cameras
from fairlead.report.video import Panel, write_gif, write_video

BASELINE = "accept-all"


@dataclass(frozen=True)
class Clip:
    """A video on the page, and the same as a moving GIF where there is one."""

    path: Path
    caption: str
    gif: Path | None

    @property
    def uri(self) -> str:
        """The file as a data URI."""
        return "data:video/mp4;base64," + base64.b64encode(self.path.read_bytes()).decode()


@contextmanager
def panels(
    config: Mapping[str, Any], scene: Mapping[str, Any], traces: Mapping[str, Path], cameras: Cameras
) -> Iterator[list[Panel]]:
    """The parts of a video of trials of a configuration in one scene, from their traces by title; as `Cameras` says."""
    with ExitStack() as opened:
        found = []
        for title, folder in traces.items():
            trace = read_trace(folder)
            points = followed(scene["goal"], trace.layout)
            camera = opened.enter_context(cameras(config, scene, SIDE))
            found.append(Panel(recording(trace, title, points), scene, points, camera))
        yield found


@contextmanager
def foretold(
    config: Mapping[str, Any], scene: Mapping[str, Any], method: str, trace: Path, cameras: Cameras
) -> Iterator[list[Panel]]:
    """The parts of a video of one trial: what its plans predicted, and beside it what happened."""
    with (
        panels(config, scene, {f"{method}: executed": trace}, cameras) as (executed,),
        cameras(config, scene, SIDE) as camera,
    ):
        predicted = as_predicted(executed.recording, f"{method}: predicted")
        yield [Panel(predicted, scene, executed.points, camera), executed]


def traced(trials: TrialSet, method: str) -> dict[tuple[str, int], dict[str, Any]]:
    """The rows of a method whose traces were kept, by scene and seed."""
    rows = trials.rows_of.get(method, [])
    return {(r["scene"], r["seed"]): r for r in rows if trials.trace(method, r["scene"], r["seed"])}


def choose(trials: TrialSet) -> list[tuple[str, list[str], tuple[str, int]]]:
    """Captions, methods and (scene, seed) of the videos.

    The reference beside `accept-all`, on the first scene where only the reference succeeds (else on any); and a success
    and a failure of the reference, each as predicted and as executed.
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
    shown = {key for _, _, key in chosen}
    for word, wanted in (("success", True), ("failure", False)):
        found = sorted((key for key in ours if ours[key]["success"] == wanted), key=lambda key: key in shown)
        caption = "A {} of {} on {}: as predicted, and as executed."
        chosen += [(caption.format(word, method, key[0]), [method], key) for key in found[:1]]
    return chosen


def make_videos(trials: TrialSet, folder: Path, cameras: Cameras) -> list[Clip]:
    """Write the videos of a set of trials, and a moving GIF of the first."""
    scenes = {scene["name"]: scene for scene in trials.scenes}
    clips = []
    for number, (caption, methods, (scene, seed)) in enumerate(choose(trials)):
        path = folder / f"{trials.name}-{number}.mp4"
        traces = {method: trials.folder / "traces" / method / f"{scene}-{seed}" for method in methods}
        show = trials.config, scenes[scene]
        pair = panels(*show, traces, cameras) if len(methods) > 1 else foretold(*show, *traces.popitem(), cameras)
        with pair as side_by_side:
            write_video(path, side_by_side)
        gif = path.with_suffix(".gif") if number == 0 else None
        if gif is not None:
            write_gif(path, gif)
        clips.append(Clip(path, caption, gif))
    return clips
