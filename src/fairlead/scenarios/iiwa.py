"""Two KUKA LBR iiwa 14 R820, mirrored on one torso, in code from published kinematics.

KUKA Roboter GmbH, LBR iiwa 7 R800, LBR iiwa 14 R820 Specification: link lengths, ranges and speeds of the joints. The
Denavit-Hartenberg chain has d = (d1, 0, d3, 0, d5, 0, d7), a = 0, alpha = (-90, 90, 90, -90, -90, 90, 0) degrees.
"""

# pyright: reportAttributeAccessIssue=false
# MuJoCo ships no type stubs.

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from fairlead.scenarios.arms import Arms

BASE, UPPER_ARM, FOREARM, FLANGE = 0.36, 0.42, 0.40, 0.126
"""Base to shoulder, to elbow, to wrist, to flange [m]: d1, d3, d5, d7."""
HAND, FINGERS = 0.10, 0.13
"""Lengths [m] of a hand on the flange and of its closed fingers, whose tips hold the rope."""
BARE_TIP = 0.012
"""How far before the tips the fingers' collision geometry ends [m]: they touch what the rope touches."""
AXES = ((0, 0, 1), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1))
"""Of the joints, stretched straight up, all angles zero."""
JOINT_LIMITS = np.deg2rad([170, 120, 170, 120, 170, 120, 175])
SPEED_LIMITS = np.deg2rad([85, 85, 100, 75, 130, 135, 135])
SHOULDER = (0.086, 0.245, 1.248)
"""First link of the left arm [m]; the right one is its mirror image in y."""
_EIGHTH = np.array([np.cos(np.pi / 8), np.sin(np.pi / 8)])
TILT = (_EIGHTH[0] ** 2, -_EIGHTH[0] * _EIGHTH[1], _EIGHTH[0] * _EIGHTH[1], _EIGHTH[1] ** 2)
"""Of the left arm's base (w, x, y, z): 45 degrees outwards, then 45 forwards."""
HOME = np.deg2rad([-70, 70, 60, -70, 0, 45, 0])
"""Left arm above the table, elbow out and up, tool down."""
MIRROR = np.array([-1, 1, -1, 1, -1, 1, -1])
"""Joint angles of the right arm in the mirror image of a posture of the left one."""
SITES = ("left_grip", "right_grip")
Colour = tuple[float, float, float, float]
GREY, DARK = (0.80, 0.82, 0.84, 1.0), (0.60, 0.63, 0.67, 1.0)


def add_torso(spec: mujoco.MjSpec) -> None:
    """What carries the arms and never moves, for pictures: a column, and from it the base of each arm."""
    x, y, z = SHOULDER
    _part(spec.worldbody, (x, 0, 0.1), (x, 0, z), 0.1, DARK)
    for side, quaternion in ((1, TILT), (-1, _mirrored(TILT))):
        _part(spec.worldbody, (x, 0, z), (x, side * y, z), 0.07, DARK)
        base = spec.worldbody.add_body(pos=(x, side * y, z), quat=quaternion)
        _part(base, (0, 0, 0), (0, 0, BASE), 0.075, GREY)


def _part(body: mujoco.MjsBody, start: Sequence[float], end: Sequence[float], radius: float, colour: Colour) -> None:
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[*start, *end], size=[radius, 0, 0], rgba=colour,
                  contype=0, conaffinity=0)  # fmt: skip


def _capsule(body: mujoco.MjsBody, start: float, end: float, radius: float) -> None:
    """Collision geometry along a body's z axis, between the centres of its ends [m]."""
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[0, 0, start, 0, 0, end], size=[radius, 0, 0], rgba=GREY)


def _mirrored(quaternion: Sequence[float]) -> Sequence[float]:
    """An orientation (w, x, y, z) in the mirror y -> -y."""
    w, x, y, z = quaternion
    return (w, -x, y, -z)


def add_arm(spec: mujoco.MjSpec, name: str, position: Sequence[float], quaternion: Sequence[float]) -> None:
    """One arm at a place [m] and orientation (w, x, y, z), with the site `{name}_grip` between its fingertips.

    Three axes meet in the shoulder and three in the wrist: three moving bodies carry the seven joints.
    """
    body = spec.worldbody.add_body(name=f"{name}_base", pos=position, quat=quaternion)
    parts = (("upper_arm", BASE, (1, 2, 3)), ("forearm", UPPER_ARM, (4,)), ("hand", FOREARM, (5, 6, 7)))
    bodies = []
    for part, offset, joints in parts:
        body = body.add_body(name=f"{name}_{part}", pos=[0, 0, offset])
        bodies.append(body)
        for i in joints:
            limit = JOINT_LIMITS[i - 1]
            body.add_joint(name=f"{name}_{i}", axis=AXES[i - 1], range=[-limit, limit], armature=0.1)
    upper_arm, forearm, hand = bodies
    palm, tip = FLANGE + HAND, FLANGE + HAND + FINGERS
    _capsule(upper_arm, 0.0, UPPER_ARM, 0.07)
    _capsule(forearm, 0.0, FOREARM, 0.065)
    _capsule(hand, 0.0, FLANGE, 0.05)
    _capsule(hand, FLANGE, palm, 0.04)
    _capsule(hand, palm, tip - BARE_TIP, 0.008)
    hand.add_site(name=f"{name}_grip", pos=[0, 0, tip])


def dual_spec() -> mujoco.MjSpec:
    """The model of both arms on their torso; its home is a posture above the table."""
    spec = mujoco.MjSpec()
    spec.modelname = "dual_iiwa"
    spec.compiler.degree = False
    x, y, z = SHOULDER
    add_torso(spec)
    add_arm(spec, "left", (x, y, z), TILT)
    add_arm(spec, "right", (x, -y, z), _mirrored(TILT))
    spec.add_key(name="home", qpos=[*HOME, *(MIRROR * HOME)])
    return spec


def dual_iiwa() -> Arms:
    """Both arms."""
    return Arms(dual_spec().compile(), SITES, SPEED_LIMITS)
