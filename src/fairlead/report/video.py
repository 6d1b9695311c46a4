"""Draws trials side by side, and encodes them: an MP4, and a small moving GIF of the same."""

from __future__ import annotations

import subprocess
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any, final

import imageio_ffmpeg
import matplotlib as mpl
import numpy as np
from jaxtyping import Float
from matplotlib.colors import LinearSegmentedColormap
from PIL import Image, ImageDraw, ImageFont

from fairlead.report.playback import FPS, SPEED, Branches, Recording, View, views
from fairlead.report.stage import SHARP, SIDE, Camera, Photographed, TopView
from fairlead.report.style import FAINT, GHOST, GOAL, GRIPPER, INK, MUTED, OUTCOMES, PAPER, ROPE
from fairlead.report.tables import counted

HEAD, FOOT, GAP, LEGEND = 50, 52, 20, 36
"""Pixels above and below a stage, between two, and of the legend below all."""
LONGEST_S = 20
"""Seconds of a video that a trial may take."""
TRUST = LinearSegmentedColormap.from_list("trust", ["#d55e00", "#e6b366", "#7fb2d9", "#0072b2"])
"""Colour of a tree's branch: trust 0.5 (just accepted) to 1."""

Font = ImageFont.FreeTypeFont


def font(size: int, bold: bool = False) -> Font:
    """The letters of pictures; `size` is in pixels of the video."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(Path(mpl.get_data_path()) / "fonts" / "ttf" / name, size * SHARP)


@final
class Panel:
    """One trial's part of the picture.

    Args:
        recording: the trial.
        scene: its scene, as a scene file writes it.
        points: indices of the rope points that the goal is for.
        camera: what it is seen through; None: from above.
    """

    def __init__(
        self, recording: Recording, scene: Mapping[str, Any], points: tuple[int, ...], camera: Camera | None
    ) -> None:
        self.recording, self.points = recording, points
        self.stage = TopView(scene, recording.layout, points) if camera is None else Photographed(camera)
        self._layer: tuple[tuple[int, float], Image.Image] | None = None
        self._drawn: tuple[View, Image.Image] | None = None

    def _planned(self, view: View) -> Image.Image:
        """The tree, and the plan when it is there; drawn once when it is full-grown."""
        if self._layer is not None and self._layer[0] == (view.episode, view.grown):
            return self._layer[1]
        episode = self.recording.episodes[view.episode]
        layer = Image.new("RGBA", (SIDE * SHARP, SIDE * SHARP))
        draw = ImageDraw.Draw(layer)
        if episode.tree is not None:
            self._tree(draw, episode.tree, view.grown)
        if episode.predicted is not None and view.grown >= 1:
            self._path(draw, episode.predicted, GHOST + "c0")
        self._layer = (view.episode, view.grown), layer
        return layer

    def _tree(self, draw: ImageDraw.ImageDraw, tree: Branches, grown: float) -> None:
        count = max(1, round(grown * len(tree.points)))
        alpha = 170 if grown < 1 else 80
        colours = np.asarray(TRUST(np.clip(2 * tree.trust[:count] - 1, 0, 1)) * 255).astype(int)
        for followed in range(tree.points.shape[1]):
            pixels = self.stage.pixels(tree.points[:count, followed])
            for node in range(1, count):
                line = [pixels[tree.parents[node]], pixels[node]]
                draw.line(line, fill=(*colours[node, :3].tolist(), alpha), width=SHARP)

    def _path(self, draw: ImageDraw.ImageDraw, states: Float[np.ndarray, "time state"], colour: str) -> None:
        for point in self.points:
            places = self.recording.layout.object_of(states)[:, point]
            draw.line(self.stage.pixels(places), fill=colour, width=2 * SHARP)

    def arena(self, view: View) -> Image.Image:
        """The world in that view: tree, plan, trail, predicted and executed rope."""
        image = self.stage.under(view)
        layer = self._planned(view)
        image.paste(layer, mask=layer)
        draw = ImageDraw.Draw(image, "RGBA")
        if len(view.trail) > 1:
            self._path(draw, np.stack(view.trail), INK + "90")
        self.stage.over(draw, view)
        return image

    def draw(self, view: View) -> Image.Image:
        """The panel: title and phase above, the arena, time and error below; of the same view, the same picture."""
        if self._drawn is None or self._drawn[0] is not view:
            self._drawn = view, self._draw(view)
        return self._drawn[1]

    def _draw(self, view: View) -> Image.Image:
        image = Image.new("RGB", (SIDE * SHARP, (HEAD + SIDE + FOOT) * SHARP), PAPER)
        arena = self.arena(view)
        image.paste(arena, (0, HEAD * SHARP))
        draw = ImageDraw.Draw(image)
        s = SHARP
        draw.rectangle((0, HEAD * s, SIDE * s - 1, (HEAD + SIDE) * s - 1), outline="#a9b2bd", width=s)
        draw.text((0, 12 * s), self.recording.title, font=font(21, bold=True), fill=INK)
        colour = OUTCOMES.get(view.phase, MUTED) if view.ended else MUTED
        draw.text((SIDE * s, 16 * s), view.phase, font=font(16, bold=view.ended), fill=colour, anchor="ra")
        below = (HEAD + SIDE + 12) * s
        plans = counted(view.plans, "plan")
        text = f"{view.seconds:5.1f} s     {plans}     {100 * view.error_m:5.1f} cm {self.recording.measured}"
        if view.ended:
            text = f"{self.recording.sentence}  {view.seconds:.1f} s, {plans}."
        draw.text((0, below), text, font=font(14), fill=INK)
        if view.trust is not None and not view.ended:
            draw.text((SIDE * s, below), f"trust {view.trust:.2f}", font=font(14), fill=MUTED, anchor="ra")
        return image


def _legend(width: int, speed: float) -> Image.Image:
    """What the colours mean, for the foot of the picture."""
    image = Image.new("RGB", (width * SHARP, 34 * SHARP), PAPER)
    draw, letters, x, s = ImageDraw.Draw(image), font(12), 0.0, SHARP
    for colour, text in ((ROPE, "rope"), (GHOST, "predicted"), (GRIPPER, "gripper"), (GOAL, "goal")):
        draw.ellipse((x, 8 * s, x + 11 * s, 19 * s), fill=colour)
        draw.text((x + 17 * s, 6 * s), text, font=letters, fill=MUTED)
        x += 17 * s + draw.textlength(text, letters) + 16 * s
    for step in range(60):
        colour = tuple(int(255 * part) for part in TRUST(step / 59)[:3])
        draw.rectangle((x + step * s, 9 * s, x + (step + 1) * s, 18 * s), fill=colour)
    draw.text((x + 68 * s, 6 * s), "tree, trust 0.5 to 1", font=letters, fill=MUTED)
    draw.text((width * s, 6 * s), f"{speed:g} x speed", font=letters, fill=MUTED, anchor="ra")
    draw.line((0, 0, width * s, 0), fill=FAINT, width=s)
    return image


def together(panels: Sequence[Panel]) -> list[list[View]]:
    """What the panels show, frame by frame; a trial that has ended keeps its last view."""
    frames: list[list[View]] = []
    for shown in zip_longest(*(views(panel.recording) for panel in panels)):
        before = frames[-1] if frames else shown
        frames.append([now or old for now, old in zip(shown, before, strict=True)])
    return frames


def frame(panels: Sequence[Panel], shown: Sequence[View], speed: float = SPEED) -> Image.Image:
    """The panels side by side over the legend, which says how fast they play."""
    width = len(panels) * SIDE + (len(panels) + 1) * GAP
    height = HEAD + SIDE + FOOT + LEGEND
    image = Image.new("RGB", (width * SHARP, height * SHARP), PAPER)
    for number, (panel, view) in enumerate(zip(panels, shown, strict=True)):
        image.paste(panel.draw(view), ((GAP + number * (SIDE + GAP)) * SHARP, 0))
    image.paste(_legend(width - 2 * GAP, speed), (GAP * SHARP, (height - LEGEND) * SHARP))
    return image.resize((width, height), Image.Resampling.BOX)


def write_frames(path: Path, frames: Iterable[Image.Image]) -> None:
    """Write an MP4; all frames have the same size."""
    path.parent.mkdir(parents=True, exist_ok=True)
    coming = iter(frames)
    first = next(coming)
    writer = imageio_ffmpeg.write_frames(
        str(path), first.size, fps=FPS, codec="libx264", macro_block_size=2,
        output_params=["-crf", "24", "-preset", "fast", "-movflags", "+faststart"],
    )  # fmt: skip
    writer.send(None)
    for image in chain([first], coming):
        writer.send(np.asarray(image).tobytes())
    writer.close()


def within(frames: list[list[View]], longest_s: float) -> tuple[list[list[View]], float]:
    """The frames, or so many of them that they take no longer [s], with the last; and how fast they play then."""
    stride = -(-len(frames) // round(longest_s * FPS))
    return [*frames[::stride], frames[-1]], SPEED * stride


def write_video(path: Path, panels: Sequence[Panel]) -> None:
    """Write an MP4 of the trials playing side by side; a long trial plays faster."""
    frames, speed = within(together(panels), LONGEST_S)
    write_frames(path, (frame(panels, shown, speed) for shown in frames))


def write_gif(video: Path, path: Path, width: int = 720, fps: int = 10) -> None:
    """A small moving GIF of a video, for pages that show no MP4."""
    palette = "split[a][b];[a]palettegen=max_colors=64[p];[b][p]paletteuse=dither=none"
    filters = f"fps={fps},scale={width}:-1:flags=lanczos,{palette}"
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-loglevel", "error", "-y", "-i", str(video), "-vf", filters, str(path)]
    subprocess.run(command, check=True, timeout=300)
