"""Following actions with two arms: Fairlead's batched inverse kinematics against mink's, the same model and waypoints.

`pip install mink daqp`, then `python -m benchmarks.kinematics`. See docs/adr/0005.
"""

# pyright: reportAttributeAccessIssue=false, reportMissingImports=false
# MuJoCo ships no type stubs; mink is no dependency.

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from fairlead.core.streams import stream
from fairlead.geometry.shapes import Box
from fairlead.scenarios.arms import CLEARANCE, PARTS, TOLERANCE, Arms
from fairlead.scenarios.dual_arm import DualArm
from fairlead.scenarios.iiwa import SITES, dual_iiwa, dual_spec

ACTIONS, ROWS, REPEATS = 64, (1, 64, 512), 5
POSITION_COST, TILT_COST, POSTURE_COST = 1000.0, 1.4, 1.0
"""Of mink's tasks: the square roots of what our minimum weighs a metre, the tool's tilt and a radian by."""


def main() -> None:
    """Print milliseconds an action for each, on one thread, and how many of mink's end within our tolerance."""
    import mink

    world, arms = DualArm(), dual_iiwa()
    scene = world.random_scene(stream(0, "kinematics"), "bench")
    boxes = [box for obstacle in scene.obstacles for box in obstacle.boxes]
    states = np.repeat(scene.state(world.layout)[None], max(ROWS), axis=0)
    targets = world.layout.grippers_of(world.sampler.propose(states, stream(1, "kinematics")))
    grippers = world.layout.grippers_of(states)
    joints, _ = arms.grasp(grippers)
    found: dict[str, float] = {}
    for rows in ROWS:
        of = joints[:rows], grippers[:rows], targets[:rows], [boxes] * rows
        found[f"ours, {rows} at once [ms]"] = 1000 * _median(lambda of=of: arms.follow(*of)) / rows
    for name, limited in (("mink", False), ("mink with its collision limit", True)):
        follow = Mink(mink, arms, boxes, limited)
        follow(joints[0], grippers[0], targets[0])
        begun = time.perf_counter()
        ends = [follow(joints[i], grippers[i], targets[i]) for i in range(ACTIONS)]
        found[f"{name} [ms]"] = 1000 * (time.perf_counter() - begun) / ACTIONS
        found[f"{name}, at the target"] = float(np.mean(np.array(ends) <= TOLERANCE))
    print(json.dumps({key: round(value, 3) for key, value in found.items()}, indent=1))


def _median(run: Callable[[], Any]) -> float:
    run()
    seconds = []
    for _ in range(REPEATS):
        begun = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - begun)
    return float(np.median(seconds))


class Mink:
    """Both arms follow their lines waypoint by waypoint, one of mink's steps each, as ours do."""

    def __init__(self, mink: Any, arms: Arms, boxes: list[Box], limited: bool) -> None:
        spec = dual_spec()
        for i, box in enumerate(boxes):
            x, y, z, w = box.quaternion_xyzw
            spec.worldbody.add_geom(name=f"box{i}", type=mujoco.mjtGeom.mjGEOM_BOX, pos=box.position,
                                    size=np.array(box.size) / 2, quat=[w, x, y, z])  # fmt: skip
        model = spec.compile()
        self._mink, self._configuration = mink, mink.Configuration(model)
        self._address = model.jnt_qposadr[arms.kinematics.joints]
        home = np.zeros(model.nq)
        home[self._address] = arms.home[..., 0]
        self._posture = mink.PostureTask(model, cost=POSTURE_COST)
        self._posture.set_target(home)
        self._tips = [mink.FrameTask(site, "site", POSITION_COST, [TILT_COST, TILT_COST, 0.0]) for site in SITES]
        self._limits = [mink.ConfigurationLimit(model)]
        if limited:
            of = [[g for g in range(model.ngeom) if model.geom(g).name == "" and _of(model, g, side)]
                  for side in ("left", "right")]  # fmt: skip
            things = [f"box{i}" for i in range(len(boxes))]
            pairs = [(of[0], of[1]), (of[0], things), (of[1], things)]
            self._limits.append(mink.CollisionAvoidanceLimit(model, pairs, minimum_distance_from_collisions=CLEARANCE))

    def __call__(self, joints: np.ndarray, grippers: np.ndarray, targets: np.ndarray) -> float:
        """How far the farther tip ends from its target [m]."""
        mink, down = self._mink, np.diag([1.0, -1.0, -1.0])
        q = np.zeros(self._configuration.model.nq)
        q[self._address] = joints.T
        self._configuration.update(q)
        for k in range(1, PARTS + 1):
            for task, at in zip(self._tips, grippers + k / PARTS * (targets - grippers), strict=True):
                task.set_target(mink.SE3.from_rotation_and_translation(mink.SO3.from_matrix(down), at))
            tasks = [self._posture, *self._tips]
            step = mink.solve_ik(self._configuration, tasks, 1.0, "daqp", limits=self._limits)
            self._configuration.integrate_inplace(step, 1.0)
        tips = [self._configuration.get_transform_frame_to_world(site, "site").translation() for site in SITES]
        return float(np.linalg.norm(np.array(tips) - targets, axis=1).max())


def _of(model: mujoco.MjModel, geom: int, side: str) -> bool:
    return model.body(model.geom_bodyid[geom]).name.startswith(side)


if __name__ == "__main__":
    main()
