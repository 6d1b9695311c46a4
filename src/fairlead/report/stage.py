"""What a trial's part of a picture shows of the world: from above, drawn here, or through a camera of the caller's."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import Any, Protocol, final

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw

from fairlead.core.layout import StateLayout
from fairlead.core.marks import Mark, marks
from fairlead.report.drawing import outlines, shape, view_of
from fairlead.report.playback import View
from fairlead.report.style import GHOST, GOAL, GRIPPER, OBSTACLE, ROPE

SIDE, SHARP = 560, 2
"""Pixels: the side of the picture; it is drawn so many times larger, and made smaller at the end."""
Pixels = list[tuple[float, float]]


class Camera(Protocol):
    """Takes square pictures of states in three dimensions."""

    def frame(
        self, state: Float[np.ndarray, " state"], ghost: Float[np.ndarray, " state"] | None = None
    ) -> UInt8[np.ndarray, "side side 3"]:
        """A picture of a state, and of a predicted one."""
        ...

    def project(self, points: Float[np.ndarray, "point 3"]) -> Float[np.ndarray, "point 2"]:
        """Where points [m] are in its pictures: right and down, 0 to 1."""
        ...


Cameras = Callable[[Mapping[str, Any], Mapping[str, Any], int], AbstractContextManager[Camera | None]]
"""Opens the camera for trials of a configuration (`scenario`, and `differences` where there are any) in a scene (as a
scene file writes it), of that side [pixels]; None: from above."""


def no_camera(config: Mapping[str, Any], scene: Mapping[str, Any], side: int) -> AbstractContextManager[Camera | None]:
    """Everything is seen from above."""
    return nullcontext(None)


def photograph(config: Mapping[str, Any], scene: Mapping[str, Any], cameras: Cameras) -> Image.Image | None:
    """A scene at its start; None where there is no camera for it."""
    with cameras(config, scene, 2 * SIDE) as camera:
        if camera is None:
            return None
        return Image.fromarray(camera.frame(np.array([*scene["grippers"].values(), *scene["rope"]], float).ravel()))


class Stage(ABC):
    """Draws a state of the world, in two parts: what lies under the planner's tree, and what lies over it."""

    @abstractmethod
    def under(self, view: View) -> Image.Image:
        """A new picture, to be drawn on."""

    @abstractmethod
    def over(self, draw: ImageDraw.ImageDraw, view: View) -> None:
        """What comes on top."""

    @abstractmethod
    def pixels(self, points: Float[np.ndarray, "point _"]) -> Pixels:
        """Where points [m] are in the picture."""


@final
class TopView(Stage):
    """Obstacles, goal and ropes from above; `points` are the rope points that the goal is for."""

    def __init__(self, scene: Mapping[str, Any], layout: StateLayout, points: tuple[int, ...]) -> None:
        self._layout, self._points = layout, points
        self._centre, self._half = view_of(scene)
        self._background = self._arena(scene)

    def under(self, view: View) -> Image.Image:
        return self._background.copy()

    def over(self, draw: ImageDraw.ImageDraw, view: View) -> None:
        if view.ghost is not None:
            self._rope(draw, view.ghost, GHOST + "d0", 10)
        rope = self._rope(draw, view.state, ROPE, 7)
        for point in self._points:
            self._dot(draw, rope[point], 6, ROPE)
        for gripper in self.pixels(self._layout.grippers_of(view.state)):
            self._dot(draw, gripper, 7, GRIPPER)

    def pixels(self, points: Float[np.ndarray, "point _"]) -> Pixels:
        scaled = ((np.asarray(points)[:, :2] - self._centre) * (1, -1) / self._half + 1) * SIDE * SHARP / 2
        return list(map(tuple, scaled.tolist()))

    def _rope(self, draw: ImageDraw.ImageDraw, state: Float[np.ndarray, " state"], colour: str, width: int) -> Pixels:
        rope = self.pixels(self._layout.object_of(state))
        draw.line(rope, fill=colour, width=width * SHARP, joint="curve")
        return rope

    @staticmethod
    def _dot(draw: ImageDraw.ImageDraw, at: tuple[float, float], radius: float, colour: str) -> None:
        (x, y), r = at, radius * SHARP
        draw.ellipse((x - r, y - r, x + r, y + r), fill=colour)

    def _arena(self, scene: Mapping[str, Any]) -> Image.Image:
        image = Image.new("RGB", (SIDE * SHARP, SIDE * SHARP), "#f7f9fb")
        draw = ImageDraw.Draw(image, "RGBA")
        for polygon in outlines(scene["obstacles"]):
            draw.polygon(self.pixels(polygon), fill=OBSTACLE, outline="#a9b2bd", width=SHARP)
        for mark in marks(scene["goal"]):
            self._mark(draw, mark)
        return image

    def _mark(self, draw: ImageDraw.ImageDraw, mark: Mark) -> None:
        """A place with its radius, or the outline of a box; one to be out of has no filling."""
        if "size" in mark:
            colour, fill = (GOAL, GOAL + "28") if mark["kind"] != "outside" else (GRIPPER, None)
            draw.polygon(self.pixels(shape(mark)), fill=fill, outline=colour, width=2 * SHARP)
            return
        (centre,) = self.pixels(shape(mark))
        radius = mark["radius"] / self._half * SIDE / 2
        self._dot(draw, centre, radius, GOAL + "40")
        self._dot(draw, centre, 3, GOAL)
        (x, y), r = centre, radius * SHARP
        draw.ellipse((x - r, y - r, x + r, y + r), outline=GOAL, width=2 * SHARP)


@final
class Photographed(Stage):
    """Pictures of a camera, taken anew only where something has moved."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._last: tuple[bytes, Image.Image] | None = None

    def under(self, view: View) -> Image.Image:
        shown = view.state.tobytes() + (b"" if view.ghost is None else view.ghost.tobytes())
        if self._last is None or self._last[0] != shown:
            picture = Image.fromarray(self._camera.frame(view.state, view.ghost))
            self._last = shown, picture.resize((SIDE * SHARP, SIDE * SHARP), Image.Resampling.NEAREST)
        return self._last[1].copy()

    def over(self, draw: ImageDraw.ImageDraw, view: View) -> None:
        pass

    def pixels(self, points: Float[np.ndarray, "point _"]) -> Pixels:
        return list(map(tuple, (self._camera.project(points) * SIDE * SHARP).tolist()))
