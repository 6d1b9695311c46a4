"""Arms that hold the rope: they follow straight lines of their grippers until a joint limit or a collision stops them.

The arms are kinematic: where they are follows from the grippers, and no part of them is in the physics.
"""

# pyright: reportAttributeAccessIssue=false
# MuJoCo ships no type stubs.

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from fairlead.core.errors import FairleadError
from fairlead.core.records import ActionOutcome
from fairlead.geometry.capsules import BoxRows, dot
from fairlead.geometry.shapes import Box
from fairlead.scenarios.kinematics import Kinematics, Posture

CLEARANCE = 0.005
"""A moving arm stays this far from obstacles and the other arm [m]."""
TOLERANCE = 0.001
"""Of the gripper's position [m]: farther from it, it counts as out of reach."""
GRASP_STEPS = 12
"""Iterations from home to a posture."""
PARTS = 6
"""The arms look at so many places along the way to a target, in execution as in planning."""
_TARGET, _LIMIT, _COLLISION = (
    o.number for o in (ActionOutcome.TARGET, ActionOutcome.JOINT_LIMIT, ActionOutcome.ARM_COLLISION)
)


@dataclass(frozen=True)
class ArmPath:
    """Straight lines of all grippers towards their targets, in K equal parts.

    joints: at each waypoint [rad]. reached: the last waypoint the arms get to, 0 to K. seconds: the shortest time [s]
    to there within the joints' speed limits. outcomes: numbers of `ActionOutcome`: TARGET, JOINT_LIMIT (out of
    reach, too) or ARM_COLLISION.
    """

    joints: Float[np.ndarray, "batch waypoint arm joint"]
    reached: Int[np.ndarray, " batch"]
    seconds: Float[np.ndarray, " batch"]
    outcomes: Int[np.ndarray, " batch"]


Floats = Sequence[float] | Float[np.ndarray, " joint"]


@final
class Arms:
    """The arms of a model, one for each site that holds a gripper.

    Args:
        model: a compiled model of the arms (see `Kinematics`) with a keyframe `home`: the posture that all others
            stay as near to as their grippers allow, its tools pointing down.
        sites: the name of the end-effector site of each arm, in the order of the grippers.
        speed_limits: of each joint of an arm [rad / s].
    """

    def __init__(self, model: mujoco.MjModel, sites: Sequence[str], speed_limits: Floats) -> None:
        self.kinematics = Kinematics(model, sites)
        if "home" not in [model.key(i).name for i in range(model.nkey)]:
            raise FairleadError("the model of the arms needs a keyframe 'home'")
        self.home = model.key("home").qpos[model.jnt_qposadr[self.kinematics.joints]][..., None]
        self.speed_limits = np.asarray(speed_limits, float)
        if self.speed_limits.shape != (len(self.home),) or not (self.speed_limits > 0).all():
            raise FairleadError(f"speed_limits: {len(self.home)} positive numbers are needed, got {list(speed_limits)}")

    @classmethod
    def from_mjcf(cls, path: Path, sites: Sequence[str], speed_limits: Floats) -> Arms:
        """Arms described by an MJCF file."""
        try:
            model = mujoco.MjModel.from_xml_path(str(path))
        except ValueError as error:
            raise FairleadError(f"{path}: {str(error).strip()}") from None
        return cls(model, sites, speed_limits)

    def grasp(
        self, grippers: Float[np.ndarray, "batch arm 3"]
    ) -> tuple[Float[np.ndarray, "batch arm joint"], Bool[np.ndarray, " batch"]]:
        """Postures [rad] with the grippers at these positions [m], and whether all arms reach them within limits."""
        targets = _batch_last(grippers)
        q = np.repeat(self.home, len(grippers), axis=-1)
        for _ in range(GRASP_STEPS):
            q = self.kinematics.improve(q, self.home, targets)
        miss, excess = self._errors(q, self.kinematics.forward(q), targets)
        return np.ascontiguousarray(q.T), (miss <= TOLERANCE) & (excess <= 0)

    def follow(
        self,
        joints: Float[np.ndarray, "batch arm joint"],
        grippers: Float[np.ndarray, "batch arm 3"],
        targets: Float[np.ndarray, "batch arm 3"],
        boxes: Sequence[Sequence[Box]],
        parts: int = PARTS,
    ) -> ArmPath:
        """Move from `joints`, where the grippers are, towards targets [m] among each row's boxes.

        The arms stop at the last waypoint before one that is out of reach, beyond a joint limit, or nearer than
        CLEARANCE to a box or the other arm; a waypoint no worse in this than the one before it is allowed, so nothing
        is locked where it is.
        """
        q, start, end = (_batch_last(x) for x in (joints, grippers, targets))
        line = start + np.linspace(0.0, 1.0, parts + 1)[:, None, None, None] * (end - start)
        path = np.empty((parts + 1, *q.shape))
        path[0] = q
        for k in range(1, parts + 1):
            path[k] = self.kinematics.improve(path[k - 1], self.home, line[k])
        allowed, in_reach = self._allowed(path, line, boxes)
        reached = np.where(allowed.all(axis=0), parts, allowed.argmin(axis=0))
        rows, stop = np.arange(len(joints)), np.minimum(reached, parts - 1)
        stopped = np.where(in_reach[stop, rows], _COLLISION, _LIMIT)
        speed = np.abs(np.diff(path, axis=0)) / self.speed_limits[:, None, None]
        seconds = np.concatenate([np.zeros((1, len(joints))), speed.max(axis=(1, 2)).cumsum(axis=0)])
        return ArmPath(
            np.ascontiguousarray(path.transpose(3, 0, 2, 1)), reached, seconds[reached, rows],
            np.where(reached == parts, _TARGET, stopped),
        )  # fmt: skip

    def clearance(
        self, joints: Float[np.ndarray, "batch arm joint"], boxes: Sequence[Sequence[Box]], horizon: float = 0.1
    ) -> Float[np.ndarray, " batch"]:
        """Least distance [m] from an arm to a box of its row or to another arm; `horizon` where all are farther."""
        posture = self.kinematics.forward(_batch_last(joints))
        return self.kinematics.capsules(posture).clearance(BoxRows.of(boxes), horizon)

    def capsules(
        self, joints: Float[np.ndarray, "arm joint"]
    ) -> tuple[Float[np.ndarray, "capsule 3"], Float[np.ndarray, "capsule 3"], Float[np.ndarray, " capsule"]]:
        """Ends [m] and radii [m] of what collides, in one posture: for pictures."""
        shapes = self.kinematics.capsules(self.kinematics.forward(_batch_last(joints[None])))
        starts, ends = shapes.starts[..., 0].T, (shapes.starts + shapes.along)[..., 0].T
        return starts, ends, shapes.radii

    def _errors(self, q: np.ndarray, posture: Posture, targets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far a tip is from its target [m], how far a joint is beyond its limits [rad]; the worst of each row."""
        gap = posture.tips - targets
        excess = np.maximum(self.kinematics.low - q, q - self.kinematics.high)
        return np.sqrt(dot(gap, gap)).max(axis=0), np.maximum(excess.max(axis=(0, 1)), 0.0)

    def _allowed(
        self, path: np.ndarray, line: np.ndarray, boxes: Sequence[Sequence[Box]]
    ) -> tuple[Bool[np.ndarray, "part batch"], Bool[np.ndarray, "part batch"]]:
        """Which waypoints after the first may be entered, and which of them are within reach and limits."""
        waypoints, batch = path.shape[0], path.shape[-1]
        q, targets = (np.moveaxis(x, 0, -2).reshape(*x.shape[1:3], -1) for x in (path, line))
        posture = self.kinematics.forward(q)
        near = self.kinematics.capsules(posture).clearance(BoxRows.of(boxes), CLEARANCE)
        miss, excess, near = (x.reshape(waypoints, batch) for x in (*self._errors(q, posture, targets), near))
        in_reach = _no_worse(miss, TOLERANCE) & _no_worse(excess, 0.0)
        return in_reach & _no_worse(-near, -CLEARANCE), in_reach


def _batch_last(rows: Float[np.ndarray, "batch arm component"]) -> Float[np.ndarray, "component arm batch"]:
    return np.ascontiguousarray(np.asarray(rows, float).transpose(2, 1, 0))


def _no_worse(values: Float[np.ndarray, "waypoint batch"], bound: float) -> Bool[np.ndarray, "part batch"]:
    """Whether each waypoint after the first is within a bound, or at least no farther from it than the one before."""
    return (values[1:] <= bound) | (values[1:] <= values[:-1] + 1e-5)
