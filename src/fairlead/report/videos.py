"""Which trials to show: the reference method beside the one without trust, successes, failures and recoveries."""

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
from fairlead.report.tables import counted
from fairlead.report.video import Panel, write_gif, write_video

BASELINE = "accept-all"
Key = tuple[str, int]
"""A scene and a seed."""


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


def traced(trials: TrialSet, method: str) -> dict[Key, dict[str, Any]]:
    """The rows of a method whose traces were kept, by scene and seed."""
    rows = trials.rows_of.get(method, [])
    return {(r["scene"], r["seed"]): r for r in rows if trials.trace(method, r["scene"], r["seed"]).is_dir()}


@dataclass(frozen=True)
class Choice:
    """Trials to show: of several methods side by side, or of one, as predicted and as executed."""

    caption: str
    methods: tuple[str, ...]
    key: Key


def choose(trials: TrialSet) -> list[Choice]:
    """Which trials to show, of those whose traces were kept.

    The reference beside `accept-all`, on the first scene where only the reference succeeds (else on any); a success and
    a failure of the reference; and a recovery after which the goal was reached, and one that led nowhere: of the
    reference if there is one, else of another method.
    """
    method, rows = trials.reference, {name: traced(trials, name) for name in trials.rows_of}
    ours, theirs = rows.get(method, {}), rows.get(BASELINE, {})
    both = [key for key in ours if key in theirs and method != BASELINE]
    chosen: list[Choice] = []
    told = [key for key in both if ours[key]["success"] and not theirs[key]["success"]]
    if both:
        key = (told or both)[0]
        why = "the first kept trial where only one of them succeeds" if told else "the first kept trial"
        chosen.append(Choice(f"{method} beside {BASELINE} on {key[0]}: {why}.", (method, BASELINE), key))
    shown = {choice.key for choice in chosen}
    for wanted in (True, False):
        found = sorted((key for key in ours if ours[key]["success"] == wanted), key=lambda key: key in shown)
        chosen += [_alone(method, key, ours[key]) for key in found[:1]]
    alone = {(choice.methods[0], choice.key) for choice in chosen if len(choice.methods) == 1}
    for wanted in (True, False):
        found = [
            (name, key)
            for name in sorted(rows, key=lambda name: name != method)
            for key, row in rows[name].items()
            if row["recovery_actions"] and row["success"] == wanted
        ]
        if not alone & set(found):
            chosen += [_alone(name, key, rows[name][key]) for name, key in found[:1]]
    return chosen


def _alone(method: str, key: Key, row: Mapping[str, Any]) -> Choice:
    """One trial, and what came of it."""
    what = "success" if row["success"] else "failure"
    stuck = f"stuck {counted(row['times_stuck'], 'time')}, {counted(row['recovery_actions'], 'recovery action')}; "
    told = stuck if row["recovery_actions"] else ""
    return Choice(f"A {what} of {method} on {key[0]}: {told}as predicted, and as executed.", (method,), key)


def make_videos(trials: TrialSet, folder: Path, cameras: Cameras) -> list[Clip]:
    """Write the videos of a set of trials, and a moving GIF of the first; none where its scenes did not travel."""
    scenes = {scene["name"]: scene for scene in trials.scenes}
    clips = []
    for number, choice in enumerate(choose(trials) if scenes else ()):
        methods, (scene, seed) = choice.methods, choice.key
        path = folder / f"{trials.name}-{number}.mp4"
        traces = {method: trials.trace(method, scene, seed) for method in methods}
        show = trials.config, scenes[scene]
        pair = panels(*show, traces, cameras) if len(methods) > 1 else foretold(*show, *traces.popitem(), cameras)
        with pair as side_by_side:
            write_video(path, side_by_side)
        gif = path.with_suffix(".gif") if number == 0 else None
        if gif is not None:
            write_gif(path, gif)
        clips.append(Clip(path, choice.caption, gif))
    return clips
