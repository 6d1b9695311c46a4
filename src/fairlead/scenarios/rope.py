"""A rope in the plane: rigid links joined by hinges, each resting on a foot that rubs on the floor.

A link moves in the plane only, so the floor does not hold it up; its weight rests on a foot on a vertical slide of its
own, whose contact with the floor gives the sliding friction mu m g. See docs/adr/0001.
"""

# pyright: reportAttributeAccessIssue=false
# MuJoCo ships no type stubs.

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np
from jaxtyping import Float

from fairlead.core.errors import FairleadError

FLOOR_BIT, OBSTACLE_BIT = 1, 2
"""Collision bits: feet touch the floor, links and grippers touch obstacles, nothing else touches."""


@dataclass(frozen=True)
class RopeFactors:
    """How another rope differs: factors on mass, friction, damping and length, and the stiffness of its joints
    [N m / rad]."""

    mass: float = 1.0
    friction: float = 1.0
    damping: float = 1.0
    length: float = 1.0
    stiffness: float = 0.0


@dataclass(frozen=True)
class PlanarRope:
    """The dragged rope.

    Args:
        links: number of links; their centres are the rope points of the state.
        link_length: distance between neighbouring joints [m].
        grip_offset: distance from the gripper to the centre of the link it holds [m].
        radius: of a link [m].
        link_mass: [kg].
        friction: sliding friction coefficient on the floor and on obstacles.
        bend_limit: largest angle between two links [rad].
        damping: of each hinge [N m s / rad].
        stiffness: of each hinge between two links [N m / rad].
    """

    links: int = 10
    link_length: float = 0.05
    grip_offset: float = 0.01
    radius: float = 0.02
    link_mass: float = 0.05
    friction: float = 0.1
    bend_limit: float = float(np.radians(160))
    damping: float = 4e-3
    stiffness: float = 0.0

    def __post_init__(self) -> None:
        lengths = (self.link_length, self.radius, self.link_mass, self.bend_limit)
        if self.links < 2 or min(lengths) <= 0 or self.grip_offset < 0:
            raise FairleadError("a rope has at least two links, and positive lengths, mass and bend limit")

    def altered(self, factors: RopeFactors) -> PlanarRope:
        """Another rope."""
        return replace(
            self,
            link_mass=self.link_mass * factors.mass,
            friction=self.friction * factors.friction,
            damping=self.damping * factors.damping,
            link_length=self.link_length * factors.length,
            stiffness=factors.stiffness,
        )

    @property
    def height(self) -> float:
        """Height of the rope points above the floor [m]."""
        return self.radius

    def add_to(self, gripper: mujoco.MjsBody) -> None:
        """Hang the chain on the gripper's body, from the gripper to the tail."""
        parent, x = gripper, 0.0
        for i in reversed(range(self.links)):
            first = i == self.links - 1
            body = parent.add_body(name=f"link{i}", pos=[x, 0, 0])
            bend = {"limited": True, "range": [-self.bend_limit, self.bend_limit], "stiffness": self.stiffness}
            body.add_joint(name=f"hinge{i}", axis=[0, 0, 1], damping=self.damping, **({} if first else bend))
            centre = self.grip_offset if first else self.link_length / 2
            end = centre + self.link_length / 2
            start = 0.0 if first else centre - self.link_length / 2
            body.add_geom(
                name=f"link{i}",
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[start, 0, 0, end, 0, 0],
                size=[self.radius, 0, 0],
                mass=1e-6,
                contype=0,
                conaffinity=OBSTACLE_BIT,
                friction=[self.friction, 0, 0],
            )
            body.add_site(name=f"point{i}", pos=[centre, 0, 0])
            self._add_foot(body, i, centre)
            parent, x = body, end

    def _add_foot(self, link: mujoco.MjsBody, i: int, centre: float) -> None:
        """The foot carries the link's mass and inertia and rests on the floor."""
        foot = link.add_body(name=f"foot{i}", pos=[centre, 0, 0])
        foot.add_joint(name=f"slide{i}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
        inertia = self.link_mass * self.link_length**2 / 12
        foot.mass, foot.inertia, foot.explicitinertial = self.link_mass, [inertia] * 3, True
        foot.add_geom(
            name=f"foot{i}",
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[self.radius / 2, 0, 0],
            pos=[0, 0, -self.radius / 2],
            contype=0,
            conaffinity=FLOOR_BIT,
            friction=[self.friction, 0, 0],
        )

    def headings(
        self, grippers: Float[np.ndarray, "batch 3"], points: Float[np.ndarray, "batch link 3"]
    ) -> Float[np.ndarray, "batch link"]:
        """Headings [rad] of the links, tail first, that best explain given link centres.

        A heading h points from the gripper towards the tail. The centres follow from the headings by
        c_n = g + o u(h_n), c_i = c_{i+1} + L/2 (u(h_{i+1}) + u(h_i)); joints are placed by least squares, by
        Gauss-Newton steps from the directions of neighbouring centres.
        """
        planar = np.concatenate([points[..., :2], grippers[:, None, :2]], axis=1)
        step = planar[:, :-1] - planar[:, 1:]
        h = np.arctan2(step[..., 1], step[..., 0])
        weights = self.centre_weights
        for _ in range(12):
            u = np.stack([np.cos(h), np.sin(h)], axis=-1)
            error = points[..., :2] - (grippers[:, None, :2] + np.einsum("ij,bjk->bik", weights, u))
            tangent = np.stack([-np.sin(h), np.cos(h)], axis=-1)
            jacobian = (weights[None, :, None, :] * tangent.transpose(0, 2, 1)[:, None]).reshape(len(h), -1, self.links)
            normal = jacobian.transpose(0, 2, 1) @ jacobian + 1e-7 * np.eye(self.links)
            gradient = jacobian.transpose(0, 2, 1) @ error.reshape(len(h), -1, 1)
            change = np.linalg.solve(normal, gradient)[..., 0]
            h = h + np.clip(change, -0.5, 0.5)
        return h

    @cached_property
    def centre_weights(self) -> Float[np.ndarray, "link link"]:
        """W with c = g + W u: how far each centre moves along each link's direction [m]."""
        n, weights = self.links, np.zeros((self.links, self.links))
        for i in range(n):
            weights[i, i] = self.link_length / 2
            weights[i, i + 1 : n - 1] = self.link_length
            weights[i, n - 1] = self.grip_offset + self.link_length / 2
        weights[n - 1, n - 1] = self.grip_offset
        return weights

    def joint_angles(self, headings: Float[np.ndarray, "batch link"]) -> Float[np.ndarray, "batch link"]:
        """Hinge angles [rad] in the order of the chain (gripper first), bends wrapped and kept within the limit."""
        chain = headings[:, ::-1]
        bends = np.diff(chain, axis=1)
        bends = (bends + np.pi) % (2 * np.pi) - np.pi
        return np.concatenate([chain[:, :1], np.clip(bends, -self.bend_limit, self.bend_limit)], axis=1)
