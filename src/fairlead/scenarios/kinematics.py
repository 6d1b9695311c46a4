"""Serial arms as arrays: forward kinematics, Jacobian and inverse kinematics of many postures at once.

Arrays have the batch last, and every formula is elementwise over it: a posture's numbers do not depend on its batch.
"""

# pyright: reportAttributeAccessIssue=false
# MuJoCo ships no type stubs.

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import mujoco
import numpy as np
from jaxtyping import Float, Int

from fairlead.core.errors import FairleadError, UnknownNameError
from fairlead.geometry.capsules import Capsules

POSITION_VARIANCE = 1e-6
"""Of the gripper's position [m^2] against 1 rad^2 of a joint: next to none; it damps steps of a stretched arm."""
TILT_VARIANCE = 0.5
"""Of the tool's direction [rad^2] against the same: a wish."""
LARGEST_STEP = 0.5
"""Of a joint in one iteration [rad]: the linear model holds no farther."""


@dataclass(frozen=True)
class Posture:
    """Where the arms are [m]: a frame on each joint's axis (z along it), the tip and the direction of each tool."""

    turns: Float[np.ndarray, "joint 3 3 arm batch"]
    origins: Float[np.ndarray, "joint 3 arm batch"]
    tips: Float[np.ndarray, "3 arm batch"]
    directions: Float[np.ndarray, "3 arm batch"]


@dataclass(frozen=True)
class _Shapes:
    """Collision geometry: the ends [m] of segments in the frame of the joint that moves them, and their radii [m]."""

    arm: Int[np.ndarray, " capsule"]
    joint: Int[np.ndarray, " capsule"]
    ends: Float[np.ndarray, "2 3 capsule"]
    radii: Float[np.ndarray, " capsule"]


def _apply(turns: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """R v for turns (..., 3, 3, arm, batch) and vectors (..., 3, arm, batch)."""
    x, y, z = (turns[..., i, :, :] * vectors[..., None, i, :, :] for i in range(3))
    return x + y + z


def _solve(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """x with M x = v for symmetric positive definite M (n, n, ...), by elimination; overwrites both."""
    n = len(vector)
    for k in range(n - 1):
        factor = matrix[k + 1 :, k] / matrix[k, k]
        matrix[k + 1 :, k + 1 :] -= factor[:, None] * matrix[k, None, k + 1 :]
        vector[k + 1 :] -= factor * vector[k]
    for k in reversed(range(n)):
        if k + 1 < n:
            vector[k] -= (matrix[k, k + 1 :] * vector[k + 1 :]).sum(0)
        vector[k] /= matrix[k, k]
    return vector


@final
class Kinematics:
    """The arms of a compiled model, one for each named site: a chain of hinges from the world to the site.

    The site sits where the arm holds things, its z axis points out of the hand. Sizes and constants are read off the
    model at joint angles zero; joints that lead to no site stay there.

    Args:
        model: a compiled model; its colliding geoms on the arms are capsules or spheres.
        sites: the name of the end-effector site of each arm.

    Raises:
        UnknownNameError: no site of that name.
        FairleadError: a joint that is not a limited hinge, arms of unequal length, a geom of another kind.
    """

    def __init__(self, model: mujoco.MjModel, sites: Sequence[str]) -> None:
        named = {model.site(i).name: i for i in range(model.nsite)}
        for name in sites:
            if name not in named:
                raise UnknownNameError("site", name, named)
        data = mujoco.MjData(model)
        data.qpos[:] = 0.0
        mujoco.mj_kinematics(model, data)
        chains = [_chain(model, model.site_bodyid[named[name]]) for name in sites]
        if not sites or not chains[0] or len({len(chain) for chain in chains}) > 1:
            raise FairleadError(f"arms of equal length are needed, got {[len(chain) for chain in chains]} joints")
        for joint in np.ravel(chains):
            if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE or not model.jnt_limited[joint]:
                raise FairleadError(f"joint '{model.joint(joint).name}': the joints of an arm are hinges with a range")
        self.joints = np.array(chains).T
        self.names = tuple(tuple(model.joint(j).name or f"joint{j}" for j in row) for row in chains)
        limits = model.jnt_range[self.joints]
        self.low, self.high = limits[..., 0, None], limits[..., 1, None]
        turns = np.stack([[_frame(data.xaxis[j]) for j in row] for row in self.joints])
        origins = data.xanchor[self.joints]
        index = [named[name] for name in sites]
        tips, directions = data.site_xpos[index], data.site_xmat[index].reshape(-1, 3, 3)[..., 2]
        # Constants between one joint's frame and the next, at angles zero: R_{j-1}^T R_j and R_{j-1}^T (o_j - o_{j-1}).
        before = np.concatenate([np.broadcast_to(np.eye(3), (1, *turns.shape[1:])), turns[:-1]])
        shifts = np.diff(origins, axis=0, prepend=np.zeros((1, *origins.shape[1:])))
        self._turns = np.einsum("jaxi,jaxk->jika", before, turns)[..., None]
        self._shifts = np.einsum("jaxi,jax->jia", before, shifts)[..., None]
        self._tips = np.einsum("axi,ax->ia", turns[-1], tips - origins[-1])[..., None]
        self._directions = np.einsum("axi,ax->ia", turns[-1], directions)[..., None]
        self._shapes = _shapes(model, data, self.joints, turns, origins)

    def forward(self, q: Float[np.ndarray, "joint arm batch"]) -> Posture:
        """R_j = R_{j-1} E_j Rot_z(q_j), o_j = o_{j-1} + R_{j-1} t_j."""
        cosine, sine = np.cos(q)[:, None], np.sin(q)[:, None]
        x, y = self._turns[:, :, 0], self._turns[:, :, 1]
        local = np.empty((len(q), 3, 3, *q.shape[1:]))
        local[:, :, 0] = x * cosine + y * sine
        local[:, :, 1] = y * cosine - x * sine
        local[:, :, 2] = self._turns[:, :, 2]
        turns = local  # Each local turn is overwritten by the product up to it.
        for j in range(1, len(q)):
            before, step = turns[j - 1], local[j]
            turns[j] = before[:, 0, None] * step[0] + before[:, 1, None] * step[1] + before[:, 2, None] * step[2]
        origins = np.empty((len(q), 3, *q.shape[1:]))
        origins[0] = self._shifts[0]
        origins[1:] = _apply(turns[:-1], self._shifts[1:])
        np.cumsum(origins, axis=0, out=origins)
        tips = origins[-1] + _apply(turns[-1], self._tips)
        return Posture(turns, origins, tips, _apply(turns[-1], self._directions))

    def jacobian(self, posture: Posture) -> Float[np.ndarray, "6 joint arm batch"]:
        """How the tip [m / rad] and the tool's direction [1 / rad] move with each joint: a_j x (p - o_j), a_j x z."""
        ax, ay, az = np.moveaxis(posture.turns[:, :, 2], 1, 0)
        px, py, pz = np.moveaxis(posture.tips - posture.origins, 1, 0)
        zx, zy, zz = posture.directions
        rows = [ay * pz - az * py, az * px - ax * pz, ax * py - ay * px,
                ay * zz - az * zy, az * zx - ax * zz, ax * zy - ay * zx]  # fmt: skip
        return np.stack(rows)

    def capsules(self, posture: Posture) -> Capsules:
        """What may collide, each capsule in the group of its arm [m]."""
        arm, joint = self._shapes.arm, self._shapes.joint
        turns, origins = posture.turns[joint, :, :, arm], posture.origins[joint, :, arm]
        start, end = (_apply(turns[..., None, :], x.T[..., None, None])[..., 0, :] for x in self._shapes.ends)
        first, along = (np.ascontiguousarray(x.swapaxes(0, 1)) for x in (origins + start, end - start))
        return Capsules(first, along, self._shapes.radii, arm)

    def improve(
        self,
        q: Float[np.ndarray, "joint arm batch"],
        home: Float[np.ndarray, "joint arm 1"],
        targets: Float[np.ndarray, "3 arm batch"],
    ) -> Float[np.ndarray, "joint arm batch"]:
        """Half a Gauss-Newton step towards the posture nearest to home with the tip at its target and the tool down.

        Minimises |q - home|^2 + |p(q) - target|^2 / POSITION_VARIANCE + |z_xy(q)|^2 / TILT_VARIANCE: with residuals
        e, their Jacobian A and variances V, q + dq where dq = h + A^T (A A^T + V)^-1 (e - A h), h = home - q.
        The minimum is a function of the target alone, so the posture hardly depends on the way there. Whole steps
        swing to and fro where an arm is nearly stretched; a last step, of the position alone, brings the tip back.
        """
        posture = self.forward(q)
        residual = np.concatenate([targets - posture.tips, -posture.directions[:2]])
        q = q + _step(self.jacobian(posture)[:5], home - q, residual) / 2
        posture = self.forward(q)
        return q + _step(self.jacobian(posture)[:3], np.zeros_like(q), targets - posture.tips)


def _step(
    a: Float[np.ndarray, "row joint arm batch"],
    pull: Float[np.ndarray, "joint arm batch"],
    residual: Float[np.ndarray, "row arm batch"],
) -> Float[np.ndarray, "joint arm batch"]:
    """h + A^T (A A^T + V)^-1 (e - A h), no joint farther than LARGEST_STEP."""
    square = (a[:, None] * a[None]).sum(2)
    for i in range(len(a)):
        square[i, i] += POSITION_VARIANCE if i < 3 else TILT_VARIANCE
    change = pull + (a * _solve(square, residual - (a * pull).sum(1))[:, None]).sum(0)
    return np.clip(change, -LARGEST_STEP, LARGEST_STEP)


def _chain(model: mujoco.MjModel, body: int) -> list[int]:
    """The joints between the world and a body, the first at the world."""
    joints: list[int] = []
    while body:
        first, count = model.body_jntadr[body], model.body_jntnum[body]
        joints = [*range(first, first + count), *joints] if count else joints
        body = model.body_parentid[body]
    return joints


def _frame(axis: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """A rotation whose third column is a unit vector."""
    x = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=-1)


def _shapes(
    model: mujoco.MjModel, data: mujoco.MjData, joints: np.ndarray, turns: np.ndarray, origins: np.ndarray
) -> _Shapes:
    """The geoms that collide and move with an arm, in the frame of the joint that moves them."""
    found: list[tuple[int, int, np.ndarray, float]] = []
    kinds = {int(mujoco.mjtGeom.mjGEOM_CAPSULE): 1.0, int(mujoco.mjtGeom.mjGEOM_SPHERE): 0.0}
    for geom in range(model.ngeom):
        chain = _chain(model, model.geom_bodyid[geom])
        moving = [(arm, j) for arm, row in enumerate(joints.T) for j, joint in enumerate(row) if joint in chain]
        if not moving or not (model.geom_contype[geom] or model.geom_conaffinity[geom]):
            continue
        if model.geom_type[geom] not in kinds:
            raise FairleadError(f"geom '{model.geom(geom).name}': what collides on an arm is a capsule or a sphere")
        arm, j = moving[-1]
        half = kinds[model.geom_type[geom]] * model.geom_size[geom, 1] * data.geom_xmat[geom].reshape(3, 3)[:, 2]
        ends = np.stack([data.geom_xpos[geom] - half, data.geom_xpos[geom] + half])
        found.append((arm, j, (ends - origins[j, arm]) @ turns[j, arm], float(model.geom_size[geom, 0])))
    if not found:
        raise FairleadError("the arms have no capsules or spheres that collide")
    arm, joint, ends, radii = zip(*found, strict=True)
    return _Shapes(np.array(arm), np.array(joint), np.stack(ends, axis=-1), np.array(radii))
