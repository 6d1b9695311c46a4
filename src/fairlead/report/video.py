"""Draws trials from above, side by side, and encodes them: an MP4, and a small moving GIF of the same."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any, final

import imageio_ffmpeg
import matplotlib as mpl
import numpy as np
from jaxtyping import Float
from matplotlib.colors import LinearSegmentedColormap
from PIL import Image, ImageDraw, ImageFont

from fairlead.core.marks import Mark, marks
from fairlead.report.drawing import outlines, shape, view_of
from fairlead.report.playback import FPS, SPEED, Episode, Recording, View, views
from fairlead.report.style import FAINT, GHOST, GOAL, GRIPPER, INK, MUTED, OBSTACLE, OUTCOMES, PAPER, ROPE
from fairlead.report.tables import counted

SIDE, HEAD, FOOT, GAP = 560, 50, 52, 20
"""Pixels: an arena's side, the space above and below it, and between."""
_SHARP = 2
TRUST = LinearSegmentedColormap.from_list("trust", ["#d55e00", "#e6b366", "#7fb2d9", "#0072b2"])
"""Colour of a tree's branch: trust 0.5 (just accepted) to 1."""

Font = ImageFont.FreeTypeFont


def _font(size: int, bold: bool = False) -> Font:
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(Path(mpl.get_data_path()) / "fonts" / "ttf" / name, size * _SHARP)


@final
class Panel:
    """One trial's part of the picture.

    Args:
        recording: the trial.
        scene: its scene, as a scene file writes it.
        points: indices of the rope points that the goal is for.
    """

    def __init__(self, recording: Recording, scene: Mapping[str, Any], points: tuple[int, ...]) -> None:
        self.recording, self.scene, self.points = recording, scene, points
        self.centre, self.half = view_of(scene)
        self._layers: dict[int, Image.Image] = {}
        self._background = self._arena()

    def _pixels(self, points: Float[np.ndarray, "count _"]) -> list[tuple[float, float]]:
        scaled = ((np.asarray(points)[:, :2] - self.centre) * (1, -1) / self.half + 1) * SIDE * _SHARP / 2
        return list(map(tuple, scaled.tolist()))

    def _dot(self, draw: ImageDraw.ImageDraw, point: Float[np.ndarray, " _"], radius: float, colour: str) -> None:
        (x, y), r = self._pixels(point[None])[0], radius * _SHARP
        draw.ellipse((x - r, y - r, x + r, y + r), fill=colour)

    def _arena(self) -> Image.Image:
        image = Image.new("RGB", (SIDE * _SHARP, SIDE * _SHARP), "#f7f9fb")
        draw = ImageDraw.Draw(image, "RGBA")
        for polygon in outlines(self.scene["obstacles"]):
            draw.polygon(self._pixels(polygon), fill=OBSTACLE, outline="#a9b2bd", width=_SHARP)
        for mark in marks(self.scene["goal"]):
            self._mark(draw, mark)
        return image

    def _mark(self, draw: ImageDraw.ImageDraw, mark: Mark) -> None:
        """A place with its radius, or the outline of a box; one to be out of has no filling."""
        if "size" in mark:
            colour, fill = (GOAL, GOAL + "28") if mark["kind"] != "outside" else (GRIPPER, None)
            draw.polygon(self._pixels(shape(mark)), fill=fill, outline=colour, width=2 * _SHARP)
            return
        centre, radius = np.array(mark["position"]), mark["radius"] / self.half * SIDE / 2
        self._dot(draw, centre, radius, GOAL + "40")
        self._dot(draw, centre, 3, GOAL)
        (x, y), r = self._pixels(centre[None])[0], radius * _SHARP
        draw.ellipse((x - r, y - r, x + r, y + r), outline=GOAL, width=2 * _SHARP)

    def _tree(self, draw: ImageDraw.ImageDraw, episode: Episode, grown: float, alpha: int) -> None:
        tree = episode.tree
        if tree is None:
            return
        count = max(1, round(grown * len(tree.points)))
        colours = np.asarray(TRUST(np.clip(2 * tree.trust[:count] - 1, 0, 1)) * 255).astype(int)
        for followed in range(tree.points.shape[1]):
            pixels = self._pixels(tree.points[:count, followed])
            for node in range(1, count):
                line = [pixels[tree.parents[node]], pixels[node]]
                draw.line(line, fill=(*colours[node, :3].tolist(), alpha), width=_SHARP)

    def _under(self, view: View) -> Image.Image:
        """Background and tree; the full-grown tree of an episode is drawn once."""
        episode = self.recording.episodes[view.episode]
        if view.grown < 1:
            image = self._background.copy()
            self._tree(ImageDraw.Draw(image, "RGBA"), episode, view.grown, 150)
            return image
        if view.episode not in self._layers:
            image = self._background.copy()
            self._tree(ImageDraw.Draw(image, "RGBA"), episode, 1.0, 60)
            self._layers = {view.episode: image}
        return self._layers[view.episode].copy()

    def arena(self, view: View) -> Image.Image:
        """The arena in that view: tree, plan, trail, predicted and executed rope."""
        image = self._under(view)
        draw = ImageDraw.Draw(image, "RGBA")
        episode = self.recording.episodes[view.episode]
        for point in self.points:
            if episode.predicted is not None and view.grown >= 1:
                draw.line(self._pixels(episode.predicted[:, point]), fill=GHOST + "c0", width=2 * _SHARP)
            if len(view.trail) > 1:
                path = np.stack([rope[point] for rope in view.trail])
                draw.line(self._pixels(path), fill=INK + "90", width=2 * _SHARP)
        if view.ghost is not None:
            self._rope(draw, view.ghost, GHOST + "d0", 10)
        self._rope(draw, view.rope, ROPE, 7)
        for point in self.points:
            self._dot(draw, view.rope[point], 6, ROPE)
        for gripper in view.grippers:
            self._dot(draw, gripper, 7, GRIPPER)
        return image

    def _rope(self, draw: ImageDraw.ImageDraw, rope: Float[np.ndarray, "point 3"], colour: str, width: int) -> None:
        draw.line(self._pixels(rope), fill=colour, width=width * _SHARP, joint="curve")

    def draw(self, view: View) -> Image.Image:
        """The panel: title and phase above, the arena, time and error below."""
        image = Image.new("RGB", (SIDE * _SHARP, (HEAD + SIDE + FOOT) * _SHARP), PAPER)
        arena = self.arena(view)
        image.paste(arena, (0, HEAD * _SHARP))
        draw = ImageDraw.Draw(image)
        s = _SHARP
        draw.rectangle((0, HEAD * s, SIDE * s - 1, (HEAD + SIDE) * s - 1), outline="#a9b2bd", width=s)
        draw.text((0, 12 * s), self.recording.title, font=_font(21, bold=True), fill=INK)
        colour = OUTCOMES.get(view.phase, MUTED) if view.ended else MUTED
        draw.text((SIDE * s, 16 * s), view.phase, font=_font(16, bold=view.ended), fill=colour, anchor="ra")
        below = (HEAD + SIDE + 12) * s
        plans = counted(view.plans, "plan")
        text = f"{view.seconds:5.1f} s     {plans}     {100 * view.error_m:5.1f} cm to the goal"
        if view.ended:
            text = f"{self.recording.sentence}  {view.seconds:.1f} s, {plans}."
        draw.text((0, below), text, font=_font(14), fill=INK)
        if view.trust is not None and not view.ended:
            draw.text((SIDE * s, below), f"trust {view.trust:.2f}", font=_font(14), fill=MUTED, anchor="ra")
        return image


def _legend(width: int) -> Image.Image:
    """What the colours mean, for the foot of the picture."""
    image = Image.new("RGB", (width * _SHARP, 34 * _SHARP), PAPER)
    draw, font, x, s = ImageDraw.Draw(image), _font(12), 0.0, _SHARP
    for colour, text in ((ROPE, "rope"), (GHOST, "predicted"), (GRIPPER, "gripper"), (GOAL, "goal")):
        draw.ellipse((x, 8 * s, x + 11 * s, 19 * s), fill=colour)
        draw.text((x + 17 * s, 6 * s), text, font=font, fill=MUTED)
        x += 17 * s + draw.textlength(text, font) + 16 * s
    for step in range(60):
        colour = tuple(int(255 * part) for part in TRUST(step / 59)[:3])
        draw.rectangle((x + step * s, 9 * s, x + (step + 1) * s, 18 * s), fill=colour)
    draw.text((x + 68 * s, 6 * s), "tree, trust 0.5 to 1", font=font, fill=MUTED)
    draw.text((width * s, 6 * s), f"{SPEED:g} x speed", font=font, fill=MUTED, anchor="ra")
    draw.line((0, 0, width * s, 0), fill=FAINT, width=s)
    return image


def frame(panels: Sequence[Panel], shown: Sequence[View]) -> Image.Image:
    """The panels side by side over the legend."""
    width = len(panels) * SIDE + (len(panels) + 1) * GAP
    height = HEAD + SIDE + FOOT + 36
    image = Image.new("RGB", (width * _SHARP, height * _SHARP), PAPER)
    for number, (panel, view) in enumerate(zip(panels, shown, strict=True)):
        image.paste(panel.draw(view), ((GAP + number * (SIDE + GAP)) * _SHARP, 0))
    image.paste(_legend(width - 2 * GAP), (GAP * _SHARP, (height - 36) * _SHARP))
    return image.resize((width, height), Image.Resampling.BOX)


def write_video(path: Path, panels: Sequence[Panel]) -> None:
    """Write an MP4 of the trials playing side by side; one that has ended keeps its last view."""
    path.parent.mkdir(parents=True, exist_ok=True)
    width, height = len(panels) * SIDE + (len(panels) + 1) * GAP, HEAD + SIDE + FOOT + 36
    writer = imageio_ffmpeg.write_frames(
        str(path), (width, height), fps=FPS, codec="libx264", macro_block_size=2,
        output_params=["-crf", "24", "-preset", "fast", "-movflags", "+faststart"],
    )  # fmt: skip
    writer.send(None)
    last: list[View | None] = [None] * len(panels)
    for shown in zip_longest(*(views(panel.recording) for panel in panels)):
        last = [new or old for new, old in zip(shown, last, strict=True)]
        writer.send(np.asarray(frame(panels, [view for view in last if view is not None])).tobytes())
    writer.close()


def write_gif(video: Path, path: Path, width: int = 720, fps: int = 10) -> None:
    """A small moving GIF of a video, for pages that show no MP4."""
    palette = "split[a][b];[a]palettegen=max_colors=64[p];[b][p]paletteuse=dither=none"
    chain = f"fps={fps},scale={width}:-1:flags=lanczos,{palette}"
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-loglevel", "error", "-y", "-i", str(video), "-vf", chain, str(path)]
    subprocess.run(command, check=True, timeout=300)
