"""Pictures and films of scenes, drawn by MuJoCo's renderer from state vectors alone."""

# pyright: reportAttributeAccessIssue=false
# MuJoCo ships no type stubs.

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, final

import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from fairlead.core.errors import FairleadError
from fairlead.core.layout import StateLayout
from fairlead.core.marks import Mark
from fairlead.geometry.shapes import Box, Obstacle
from fairlead.scenarios.arms import Arms

Colour = tuple[float, float, float, float]
ROPE: Colour = (0.11, 0.15, 0.20, 1.0)
GHOST: Colour = (0.90, 0.62, 0.00, 0.60)
GRIPPER: Colour = (0.80, 0.20, 0.07, 1.0)
GOAL: Colour = (0.00, 0.62, 0.45, 0.55)
VOLUME: Colour = (0.00, 0.62, 0.45, 0.18)
FORBIDDEN: Colour = (0.80, 0.20, 0.07, 0.75)
EDGE = 0.003
"""Radius of the edges of a drawn box [m]."""
OBSTACLE: Colour = (0.58, 0.63, 0.70, 1.0)
ARM: Colour = (0.80, 0.82, 0.84, 1.0)


@final
class SceneRenderer:
    """Draws states of one scene. Use as a context manager: it holds a graphics context.

    Args:
        backdrop: a model with what never moves, lights and a camera called `view`.
        layout: how to read a state.
        rope_radius: of the drawn rope [m].
        obstacles: the scene's obstacles.
        goal: the balls and boxes of a goal.
        width, height: of a frame [pixels].
        arms: that hold the grippers, or None.
        colours: of obstacles, by name; the others are grey.
        shadows: whether there are any; without a graphics card they take most of the time.
    """

    def __init__(
        self,
        backdrop: mujoco.MjModel,
        layout: StateLayout,
        rope_radius: float,
        obstacles: Sequence[Obstacle],
        goal: Sequence[Mark],
        width: int = 800,
        height: int = 800,
        arms: Arms | None = None,
        colours: Mapping[str, Colour] | None = None,
        shadows: bool = True,
    ) -> None:
        backdrop.vis.global_.offwidth = max(backdrop.vis.global_.offwidth, width)
        backdrop.vis.global_.offheight = max(backdrop.vis.global_.offheight, height)
        try:
            self._renderer = mujoco.Renderer(backdrop, height, width)
        except (RuntimeError, AttributeError, mujoco.FatalError) as error:
            raise FairleadError(
                f"no off-screen rendering here ({error}); try MUJOCO_GL=egl or MUJOCO_GL=osmesa"
            ) from None
        self._data = mujoco.MjData(backdrop)
        mujoco.mj_forward(backdrop, self._data)
        self._view, self._aspect = backdrop.camera("view").id, width / height
        self._fovy = float(backdrop.cam_fovy[self._view])
        self._layout, self._radius, self._obstacles, self._goal = layout, rope_radius, obstacles, goal
        self._arms, self._colours, self._shadows = arms, colours or {}, shadows

    def __enter__(self) -> SceneRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        self._renderer.close()

    def frame(
        self, state: Float[np.ndarray, " state"], ghost: Float[np.ndarray, " state"] | None = None
    ) -> UInt8[np.ndarray, "height width 3"]:
        """One picture of a state; `ghost` is a second one (a prediction), drawn translucent."""
        self._renderer.update_scene(self._data, camera="view")
        self._renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = self._shadows
        for obstacle in self._obstacles:
            colour = self._colours.get(obstacle.name, OBSTACLE)
            for i, box in enumerate(obstacle.boxes):
                half = np.array(box.size) / 2 - 0.001 * i
                self._add(mujoco.mjtGeom.mjGEOM_BOX, half, box.position, colour, box.rotation)
        for mark in self._goal:
            self._mark(mark)
        if ghost is not None:
            self._rope(ghost, GHOST)
        self._rope(state, ROPE)
        if self._arms is not None:
            joints, _ = self._arms.grasp(self._layout.grippers_of(state)[None])
            for start, end, radius in zip(*self._arms.capsules(joints[0]), strict=True):
                self._capsule(start, end, radius, ARM)
        return self._renderer.render()

    def project(self, points: Float[np.ndarray, "point 3"]) -> Float[np.ndarray, "point 2"]:
        """Where points [m] are in a frame: right and down, from 0 to 1."""
        turn = self._data.cam_xmat[self._view].reshape(3, 3)
        x, y, z = ((points - self._data.cam_xpos[self._view]) @ turn).T  # the camera looks along -z
        high = -2 * z * np.tan(np.radians(self._fovy) / 2)
        return np.stack([0.5 + x / (high * self._aspect), 0.5 - y / high], axis=-1)

    def _mark(self, mark: Mark) -> None:
        """A ball, a box to be in, or the edges of a box to be out of."""
        if "size" not in mark:
            self._add(mujoco.mjtGeom.mjGEOM_SPHERE, [mark["radius"], 0, 0], mark["position"], GOAL)
            return
        box = Box(*(tuple(mark[key]) for key in ("size", "position", "quaternion_xyzw")))
        if mark["kind"] != "outside":
            self._add(mujoco.mjtGeom.mjGEOM_BOX, np.array(box.size) / 2, box.position, VOLUME, box.rotation)
        corners = box.corners()
        for i, start in enumerate(corners):
            for step in (1, 2, 4):
                if not i & step:
                    self._capsule(start, corners[i | step], EDGE, GOAL if mark["kind"] != "outside" else FORBIDDEN)

    def _rope(self, state: Float[np.ndarray, " state"], colour: Colour) -> None:
        points, grippers = self._layout.points_of(state), self._layout.grippers_of(state)
        chain = np.concatenate([points, grippers[-1:]])
        if len(grippers) > 1:
            chain = np.concatenate([grippers[:1], chain])
        for start, end in pairwise(chain):
            self._capsule(start, end, self._radius, colour)
        held = GRIPPER if colour is ROPE else colour
        for gripper in grippers:
            self._add(mujoco.mjtGeom.mjGEOM_SPHERE, [1.3 * self._radius, 0, 0], gripper, held)

    def _capsule(self, start: np.ndarray, end: np.ndarray, radius: float, colour: Colour) -> None:
        geom = self._add(mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3), np.zeros(3), colour)
        mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, radius, start, end)

    def _add(self, kind: mujoco.mjtGeom, size: Any, position: Any, colour: Colour, matrix: Any = None) -> Any:
        scene = self._renderer.scene
        geom = scene.geoms[scene.ngeom]
        rotation = np.eye(3) if matrix is None else matrix
        mujoco.mjv_initGeom(geom, kind, np.asarray(size, float), np.asarray(position, float), rotation.ravel(),
                            np.array(colour, np.float32))  # fmt: skip
        scene.ngeom += 1
        return geom


def plain_backdrop(bounds: Float[np.ndarray, "2 3"]) -> mujoco.MjModel:
    """A floor under the region between two corners [m], seen from above."""
    x, y = (bounds[0, :2] + bounds[1, :2]) / 2
    half = float((bounds[1, :2] - bounds[0, :2]).max()) / 2
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[half, half, 0.1], pos=[x, y, bounds[0, 2]],
                            rgba=[0.93, 0.94, 0.95, 1])  # fmt: skip
    spec.worldbody.add_light(pos=[x + half, y - half, 3 * half], dir=[-0.3, 0.3, -1], diffuse=[0.4, 0.4, 0.4])
    spec.visual.headlight.ambient = spec.visual.headlight.diffuse = [0.3, 0.3, 0.3]
    spec.visual.headlight.specular = [0, 0, 0]
    spec.worldbody.add_camera(name="view", pos=[x, y, bounds[1, 2] + 2.6 * half], fovy=45)
    return spec.compile()
