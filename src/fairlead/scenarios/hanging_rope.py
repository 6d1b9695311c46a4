"""A rope held at both ends: rigid links joined by pairs of hinges, its ends tied to two gripper points that are moved.

Hinges bend but do not twist, so that a rope has no state that its points do not show. See docs/adr/0004.
"""

# pyright: reportAttributeAccessIssue=false
# MuJoCo ships no type stubs.

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

from fairlead.core.errors import FairleadError
from fairlead.scenarios.rope import OBSTACLE_BIT, RopeFactors

ROPE_BIT = 4
"""Collision bit: the rope touches obstacles and itself, except that neighbouring links do not touch."""
SIDES = ("left", "right")


@dataclass(frozen=True)
class HangingRope:
    """The rope between two grippers; link 0 is at the left one.

    Args:
        links: an odd number; their centres are the rope points of the state.
        link_length: distance between neighbouring joints, and from a gripper to the first one [m].
        radius: of a link [m].
        link_mass: [kg].
        damping: of each hinge [N m s / rad].
        armature: inertia added to each hinge [kg m^2]; it keeps a taut rope stable.
        bend_limit: of the second hinge of a pair [rad]; at a quarter turn the pair locks. The first has none.
        friction: sliding [1], torsional [m] and rolling [m] friction coefficients.
        stiffness: of each hinge [N m / rad].
    """

    links: int = 25
    link_length: float = 0.0323
    radius: float = 0.01
    link_mass: float = 0.2
    damping: float = 0.01
    armature: float = 2e-4
    bend_limit: float = float(np.radians(85))
    friction: tuple[float, float, float] = (1.0, 0.01, 0.01)
    stiffness: float = 0.0

    def __post_init__(self) -> None:
        if self.links < 3 or self.links % 2 == 0:
            raise FairleadError(f"links {self.links}: an odd number of at least 3 is needed")
        if min(self.link_length, self.radius, self.link_mass, self.damping, self.bend_limit) <= 0:
            raise FairleadError("a rope has positive lengths, mass, damping and bend limit")

    def altered(self, factors: RopeFactors) -> HangingRope:
        """Another rope."""
        sliding, torsional, rolling = self.friction
        return replace(
            self,
            link_mass=self.link_mass * factors.mass,
            friction=(sliding * factors.friction, torsional * factors.friction, rolling * factors.friction),
            damping=self.damping * factors.damping,
            link_length=self.link_length * factors.length,
            stiffness=factors.stiffness,
        )

    @property
    def length(self) -> float:
        """From gripper to gripper, stretched out [m]."""
        return self.links * self.link_length

    @property
    def middle(self) -> int:
        """The link in the middle, where the chain has its root."""
        return self.links // 2

    def add_to(self, spec: mujoco.MjSpec) -> None:
        """Add the chain, rooted at its middle link, and the mocap bodies `left` and `right` that hold its ends."""
        half = self.link_length / 2
        middle = spec.worldbody.add_body(name=f"link{self.middle}", pos=[0, 0, 2])
        middle.add_freejoint(name="middle")
        self._add_link(middle, self.middle, 0.0)
        for side, sign in zip(SIDES, (-1, 1), strict=True):
            parent = middle
            for k in range(1, self.middle + 1):
                i = self.middle + sign * k
                body = parent.add_body(name=f"link{i}", pos=[sign * (half if k == 1 else 2 * half), 0, 0])
                for axis, direction in (("y", [0, 1, 0]), ("z", [0, 0, 1])):
                    body.add_joint(name=f"{axis}{i}", axis=direction, damping=self.damping, armature=self.armature,
                                   stiffness=self.stiffness, limited=axis == "z",
                                   range=[-self.bend_limit, self.bend_limit])  # fmt: skip
                self._add_link(body, i, sign * half)
                parent = body
            end = parent.add_site(name=f"{side}_end", pos=[2 * sign * half, 0, 0])
            gripper = spec.worldbody.add_body(name=side, mocap=True, pos=[sign * self.length / 2, 0, 2])
            hold = gripper.add_site(name=side)
            spec.add_equality(name=side, type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_SITE,
                              name1=end.name, name2=hold.name, solref=[0.008, 0.5])  # fmt: skip

    def _add_link(self, body: mujoco.MjsBody, i: int, centre: float) -> None:
        half = self.link_length / 2
        body.add_geom(
            name=f"link{i}", type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[self.radius, 0, 0],
            fromto=[centre - half, 0, 0, centre + half, 0, 0], mass=self.link_mass, contype=ROPE_BIT,
            conaffinity=OBSTACLE_BIT | ROPE_BIT, condim=6, friction=list(self.friction), solref=[0.008, 1],
            priority=1,
        )  # fmt: skip
        body.add_site(name=f"point{i}", pos=[centre, 0, 0])

    def hanging(self, grippers: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "link 3"]:
        """Link centres [m] of the rope hanging freely between two points: a catenary.

        With span h, rise v and length l, x = h / 2a solves sinh(x) / x = sqrt(l^2 - v^2) / h.
        """
        left, right = grippers
        across, v = np.append(right[:2] - left[:2], 0.0), right[2] - left[2]
        h, length = max(float(np.linalg.norm(across)), 1e-3), 1.0001 * self.length
        if h**2 + v**2 >= length**2:
            raise FairleadError(f"the grippers are {np.hypot(h, v):.3f} m apart; the rope is {self.length:.3f} m long")
        ratio = np.sqrt(length**2 - v**2) / h
        x = float(brentq(lambda x: np.sinh(x) / x - ratio, 1e-6, 20.0))  # type: ignore[arg-type]
        a = h / (2 * x)
        lowest = h / 2 - a * np.arctanh(v / length)
        arc = (np.arange(self.links) + 0.5) / self.links * length
        along = lowest + a * np.arcsinh(arc / a + np.sinh(-lowest / a))
        z = left[2] + a * (np.cosh((along - lowest) / a) - np.cosh(lowest / a))
        points = left + across * (along / h)[:, None]
        points[:, 2] = z
        return points

    @cached_property
    def centre_weights(self) -> Float[np.ndarray, "link link"]:
        """W with c = x + W u for a rope that begins at x: how far centres move along each link's direction [m]."""
        return self.link_length * (np.tri(self.links) - 0.5 * np.eye(self.links))

    def directions(self, points: Float[np.ndarray, "batch link 3"]) -> Float[np.ndarray, "batch link 3"]:
        """Unit vectors along the links, left to right, that best explain the link centres.

        Levenberg-Marquardt on spheres: u <- normalise(u + B d) with B an orthonormal basis across u, for the centres
        relative to their mean, so that where the rope begins does not matter.
        """
        weights, count = self.centre_weights - self.centre_weights.mean(axis=0), self.links
        centred, gram = points - points.mean(axis=1, keepdims=True), weights.T @ weights
        u = _unit(np.diff(points, axis=1)[:, np.r_[: self.middle + 1, self.middle : count - 1]])
        error = centred - np.einsum("ij,bjk->bik", weights, u)
        lift = np.full(len(u), 1e-3)
        for _ in range(10):
            basis = _tangents(u)
            turn = np.einsum("bjka,blkc->bjalc", basis, basis) * gram[None, :, None, :, None]
            normal = turn.reshape(len(u), 2 * count, 2 * count) + lift[:, None, None] * np.eye(2 * count)
            gradient = np.einsum("bjka,bjk->bja", basis, np.einsum("ij,bik->bjk", weights, error))
            step = np.linalg.solve(normal, gradient.reshape(len(u), -1, 1)).reshape(len(u), count, 2)
            tried = _unit(u + np.einsum("bjka,bja->bjk", basis, np.clip(step, -0.5, 0.5)))
            left = centred - np.einsum("ij,bjk->bik", weights, tried)
            better = (left * left).sum((1, 2)) < (error * error).sum((1, 2))
            lift *= np.where(better, 0.1, 10.0)
            u, error = (np.where(better[:, None, None], new, old) for new, old in ((tried, u), (left, error)))
        return u

    def joint_positions(
        self, grippers: Float[np.ndarray, "batch 2 3"], points: Float[np.ndarray, "batch link 3"]
    ) -> Float[np.ndarray, "batch position"]:
        """qpos that lays the rope along given points: pose of the middle link, then hinges to the left and right.

        The roll of the middle link, which no point shows, is that of the shortest turn from the horizontal direction
        between the grippers, so that it turns with the world.
        """
        u = self.directions(points)
        fitted = np.einsum("ij,bjk->bik", self.centre_weights, u)
        fitted += (points - fitted).mean(axis=1, keepdims=True)
        across = grippers[:, 1] - grippers[:, 0]
        across[:, 2] = 0.0
        across[np.linalg.norm(across, axis=1) < 1e-6] = [1.0, 0.0, 0.0]
        across = _unit(across)
        m = self.middle
        yaw = np.zeros((len(u), 3, 3))
        yaw[:, :, 0], yaw[:, 2, 2] = across, 1.0
        yaw[:, 0, 1], yaw[:, 1, 1] = -across[:, 1], across[:, 0]
        root = _shortest_turn(across, u[:, m]) @ yaw
        parts = [fitted[:, m], _quaternion(root)]
        for sign in (-1, 1):
            frame = root
            for k in range(1, m + 1):
                d = np.einsum("bij,bi->bj", frame, u[:, m + sign * k])
                a, b = np.arctan2(-d[:, 2], d[:, 0]), np.arcsin(np.clip(d[:, 1], -1.0, 1.0))
                b = np.clip(b, -self.bend_limit, self.bend_limit)
                parts.append(np.stack([a, b], axis=1))
                frame = frame @ _bend(a, b)
        return np.concatenate(parts, axis=1)


def _unit(vectors: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def _tangents(u: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 2"]:
    """Two unit vectors across each unit vector."""
    axis = np.where(np.abs(u[..., :1]) < 0.7, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    first = _unit(np.cross(u, axis))
    return np.stack([first, np.cross(u, first)], axis=-1)


def _bend(a: Float[np.ndarray, " batch"], b: Float[np.ndarray, " batch"]) -> Float[np.ndarray, "batch 3 3"]:
    """R_y(a) R_z(b), the turn of a pair of hinges; it carries x to (cos a cos b, sin b, -sin a cos b)."""
    ca, sa, cb, sb = np.cos(a), np.sin(a), np.cos(b), np.sin(b)
    rows = [[ca * cb, -ca * sb, sa], [sb, cb, np.zeros_like(a)], [-sa * cb, sa * sb, ca]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _shortest_turn(
    start: Float[np.ndarray, "batch 3"], end: Float[np.ndarray, "batch 3"]
) -> Float[np.ndarray, "batch 3 3"]:
    """R = I + [v] + [v]^2 / (1 + c) with v = start x end and c = start . end; half a turn is not defined."""
    v, c = np.cross(start, end), (start * end).sum(axis=1)
    cross = np.zeros((len(v), 3, 3))
    cross[:, [2, 0, 1], [1, 2, 0]], cross[:, [1, 2, 0], [2, 0, 1]] = v, -v
    return np.eye(3) + cross + cross @ cross / np.maximum(1.0 + c, 1e-6)[:, None, None]


def _quaternion(matrices: Float[np.ndarray, "batch 3 3"]) -> Float[np.ndarray, "batch 4"]:
    """Quaternions (w, x, y, z)."""
    quaternions = np.empty((len(matrices), 4))
    for quaternion, matrix in zip(quaternions, matrices, strict=True):
        mujoco.mju_mat2Quat(quaternion, matrix.ravel())
    return quaternions
