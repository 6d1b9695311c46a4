"""Two Franka Emika Panda arms on a mount of their own, in code from published kinematics: arms other than in training.

Franka Emika, Franka Control Interface Documentation, "Robot and interface specifications": the modified Denavit-
Hartenberg chain (Craig's), the ranges and speeds of the joints.
"""

# pyright: reportAttributeAccessIssue=false
# MuJoCo ships no type stubs.

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from fairlead.scenarios.arms import Arms

CHAIN = (
    (0.0, 0.333, 0), (0.0, 0.0, -90), (0.0, 0.316, 90), (0.0825, 0.0, 90), (-0.0825, 0.384, -90), (0.0, 0.0, 90),
    (0.088, 0.0, 90),
)  # fmt: skip
"""Of each joint, from the frame before it: a [m] along x, d [m] along the joint, alpha [degrees] about x."""
RANGES = (
    (-2.8973, 2.8973), (-1.7628, 1.7628), (-2.8973, 2.8973), (-3.0718, -0.0698), (-2.8973, 2.8973), (-0.0175, 3.7525),
    (-2.8973, 2.8973),
)  # fmt: skip
SPEED_LIMITS = (2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61)
FLANGE, PALM, TIP, BARE_TIP = 0.107, 0.167, 0.307, 0.012
"""From the last joint's frame to the flange, the end of the hand and the fingertips; where no finger collides [m]."""
SHOULDER, TILT = (0.05, 0.32, 1.15), (-35, 40)
"""Base of the left arm [m], tilted [degrees] outwards, about x, then forwards, about y. The right one mirrors it."""
HOME = (-0.41, 0.24, -0.25, -1.98, 1.18, 2.15, 0.0)
"""Left arm above the table, tool down [rad]."""
MIRROR = np.array([-1, 1, -1, 1, -1, 1, -1])


def dual_panda() -> Arms:
    """Both arms; their home is a posture above the table."""
    spec = mujoco.MjSpec()
    spec.modelname = "dual_panda"
    spec.compiler.degree = False
    (x, y, z), (out, forward) = SHOULDER, TILT
    for name, side in (("left", 1), ("right", -1)):
        _add_arm(spec, name, (x, side * y, z), Rotation.from_euler("xy", (side * out, forward), degrees=True))
    spec.add_key(name="home", qpos=[*HOME, *(MIRROR * HOME)])
    return Arms(spec.compile(), ("left_grip", "right_grip"), SPEED_LIMITS)


def _add_arm(spec: mujoco.MjSpec, name: str, position: Sequence[float], base: Rotation) -> None:
    """One arm with the site `{name}_grip` between its fingertips."""
    body = spec.worldbody.add_body(name=f"{name}_base", pos=position, quat=base.as_quat(scalar_first=True))
    for i, ((a, d, alpha), limits) in enumerate(zip(CHAIN, RANGES, strict=True), start=1):
        turn = Rotation.from_euler("x", alpha, degrees=True)
        offset = np.array([a, 0.0, 0.0]) + turn.apply([0.0, 0.0, d])
        if i > 1 and offset.any():
            _capsule(body, (0, 0, 0), offset.tolist(), 0.055)
        body = body.add_body(name=f"{name}_{i}", pos=offset, quat=turn.as_quat(scalar_first=True))
        body.add_joint(name=f"{name}_{i}", axis=[0, 0, 1], range=limits, armature=0.1)
        # Where axes meet, a body between two joints has no shape to take a mass from; only its place matters.
        body.mass, body.inertia, body.explicitinertial = 1.0, [0.01] * 3, True
    _capsule(body, (0, 0, 0), (0, 0, PALM), 0.045)
    _capsule(body, (0, 0, PALM), (0, 0, TIP - BARE_TIP), 0.008)
    body.add_site(name=f"{name}_grip", pos=[0, 0, TIP])


def _capsule(body: mujoco.MjsBody, start: Sequence[float], end: Sequence[float], radius: float) -> None:
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[*start, *end], size=[radius, 0, 0])
