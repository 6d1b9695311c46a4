"""The simulated table: a rope held at both ends above movable boxes, by grippers that two kinematic arms carry."""

# pyright: reportAttributeAccessIssue=false
# MuJoCo ships no type stubs.

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import final

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome
from fairlead.geometry.shapes import Box, Obstacle
from fairlead.scenarios.arms import PARTS, Arms
from fairlead.scenarios.hanging_rope import SIDES, HangingRope
from fairlead.scenarios.obstacles import Sizes, add_boxes, box_sizes, place_boxes
from fairlead.scenarios.rope import OBSTACLE_BIT
from fairlead.scenarios.simulate import PhysicalWorld, Simulation, base_options

LAYOUT = StateLayout(("left_gripper", "right_gripper"), 25)
TABLE = Box((0.8, 1.5, 0.12), (0.8, 0.0, 0.565))
_TARGET, _STRETCH, _DIVERGED = (o.number for o in (ActionOutcome.TARGET, ActionOutcome.STRETCH, ActionOutcome.DIVERGED))


REST_TICKS = 3
"""The rope rests after so many ticks without motion; one alone may be the turning point of a swing."""
BACK, REST, FORTH = -1, 0, 1


@dataclass(frozen=True)
class Grippers:
    """How the two gripper points move, and when the rope counts as at rest.

    Both move along straight lines, in step, the faster one at `speed` [m/s] unless the arms need longer. Where an end
    of the rope is more than `stretch` [m] away from its gripper, both go back the way they came until it is not.
    Velocities of the rope decay with the time constant `damping` [s] besides what physics does to them: without it the
    rope swings for seconds. It is at rest when no point moves faster than `rest_speed` [m/s], or after `patience` [s].
    """

    speed: float = 0.2
    stretch: float = 0.0032
    damping: float = 0.1
    rest_speed: float = 0.0015
    patience: float = 3.0
    substeps: int = 5


@lru_cache(maxsize=16)
def build_model(sizes: Sizes | None, rope: HangingRope) -> mujoco.MjModel:
    """The compiled model, kept for the next world with boxes of the same sizes."""
    return build_spec(sizes, rope).compile()


def build_spec(sizes: Sizes | None, rope: HangingRope) -> mujoco.MjSpec:
    """The rope; the table and one movable box for each of `sizes`, unless that is None: nothing to touch."""
    spec = mujoco.MjSpec()
    spec.modelname = "dual_arm"
    base_options(spec)
    spec.option.impratio = 50
    if sizes is not None:
        spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_BOX, size=np.array(TABLE.size) / 2,
                                pos=TABLE.position, contype=OBSTACLE_BIT, conaffinity=0)  # fmt: skip
    rope.add_to(spec)
    add_boxes(spec, sizes or (), rope.friction[0])
    return spec


@final
class DualArmWorld(PhysicalWorld):
    """Copies of the table, one for each row of `states`, settled at the start.

    `obstacles` None is the unconstrained world of phase 1: no table, no obstacles. `arms` None: nothing carries the
    grippers.

    Raises:
        FairleadError: rows with boxes of different sizes.
    """

    def __init__(
        self,
        obstacles: Sequence[Sequence[Obstacle]] | None,
        states: Float[np.ndarray, "batch state"],
        threads: int,
        rope: HangingRope,
        motion: Grippers,
        arms: Arms | None,
    ) -> None:
        sizes = None if obstacles is None else box_sizes(obstacles[0])
        model, count = build_model(sizes, rope), len(states)
        super().__init__(Simulation(model, count, threads), LAYOUT, motion.substeps * model.opt.timestep)
        self.rope, self.motion, self.arms = rope, motion, arms
        if obstacles is not None:
            place_boxes(self.simulation.batch, obstacles)
        self._sites, self._holders = self.simulation.batch.bind("site_xpos"), self.simulation.mocap[:, : len(SIDES)]
        self._boxes = [[TABLE, *(box for o in row for box in o.boxes)] for row in obstacles or ((),) * count]
        self._points = np.array([model.site(f"point{i}").id for i in range(rope.links)])
        self._ends = np.array([model.site(f"{side}_end").id for side in SIDES])
        self._holds = np.array([model.site(side).id for side in SIDES])
        self._decay = float(np.exp(-self._tick_s / motion.damping))
        self._from, self._to = np.zeros((2, count, 2, 3))
        self._path = np.zeros((count, PARTS + 1, len(SIDES), 0 if arms is None else len(arms.home)))
        self._progress, self._limit, self._pace = np.zeros((3, count))
        self._way, self._still = np.zeros((2, count), int)
        self._where = np.zeros((count, rope.links, 3))
        self._settle(states)

    def _lay(self, ids: Int[np.ndarray, " some"], states: Float[np.ndarray, "some state"]) -> None:
        """Each rope is held and at rest; the arms grasp its ends."""
        grippers = LAYOUT.grippers_of(states)
        self.simulation.qpos[ids] = self.rope.joint_positions(grippers, LAYOUT.points_of(states))
        self._holders[ids] = self._from[ids] = self._to[ids] = grippers
        if self.arms is not None:
            self._path[ids] = self.arms.grasp(grippers)[0][:, None]
        self._where[ids] = 0.0
        self._move(ids, np.zeros(len(ids)), np.zeros(len(ids)), np.full(len(ids), _TARGET))

    def _observe(self, ids: Int[np.ndarray, " some"]) -> Float[np.ndarray, "some state"]:
        self.simulation.batch.forward(ids, stage=mujoco.mjtStage.mjSTAGE_POS.value)
        return LAYOUT.join(self._holders[ids], self._sites[np.ix_(ids, self._points)])

    def _begin(self, ids: Int[np.ndarray, " some"], actions: Float[np.ndarray, "some action"]) -> None:
        start, target = self._holders[ids], actions.reshape(len(ids), len(SIDES), 3)
        limit, outcome = np.ones(len(ids)), np.full(len(ids), _TARGET)
        seconds = np.linalg.norm(target - start, axis=-1).max(axis=1) / self.motion.speed
        if self.arms is not None:
            path = self.arms.follow(self._joints(ids), start, target, [self._boxes[i] for i in ids], PARTS)
            self._path[ids] = path.joints
            limit, outcome = path.reached / PARTS, path.outcomes
            seconds = np.maximum(seconds * limit, path.seconds)
        self._from[ids], self._to[ids] = start, target
        self._move(ids, limit, seconds, outcome)

    def _joints(self, ids: Int[np.ndarray, " some"]) -> Float[np.ndarray, "some arm joint"]:
        """Where the arms are [rad]: as far as the last motion came, or at its start where it diverged."""
        at = np.where(self._outcome[ids] == _DIVERGED, 0.0, self._progress[ids]) * PARTS
        low = np.minimum(at.astype(int), PARTS - 1)
        fraction = (at - low)[:, None, None]
        return (1 - fraction) * self._path[ids, low] + fraction * self._path[ids, low + 1]

    def _move(self, ids: Int[np.ndarray, " some"], limit: np.ndarray, seconds: np.ndarray, outcome: np.ndarray) -> None:
        """Begin motions up to a fraction `limit` of the way that take so many seconds."""
        self._progress[ids], self._still[ids], self._outcome[ids] = 0.0, 0, outcome
        self._limit[ids], self._pace[ids], self._way[ids] = limit, limit / np.maximum(seconds, self._tick_s), FORTH

    def _tick(self, ids: Int[np.ndarray, " active"]) -> Bool[np.ndarray, " active"]:
        """Move the grippers until a stop or the target, damping the rope, and wait for it to come to rest."""
        simulation, count = self.simulation, self.motion.substeps
        begun = self._progress[ids]
        ended = np.clip(begun + self._way[ids] * self._pace[ids] * self._tick_s, 0.0, self._limit[ids])
        start, way = self._from[ids], self._to[ids] - self._from[ids]
        for k in range(1, count + 1):
            fraction = begun + (ended - begun) * (k / count)
            self._holders[ids] = start + fraction[:, None, None] * way
            simulation.step(ids)
        simulation.qvel[ids] *= self._decay
        self._progress[ids] = ended
        sites = self._sites[ids]
        self._turn(ids, sites[:, self._ends] - sites[:, self._holds])
        moved = sites[:, self._points] - self._where[ids]
        self._where[ids] = sites[:, self._points]
        still = (moved * moved).sum(-1).max(-1) < (self.motion.rest_speed * self._tick_s) ** 2
        self._still[ids] = np.where(still & (self._way[ids] == REST), self._still[ids] + 1, 0)
        bad = simulation.diverged(ids)
        self._outcome[ids[bad]] = _DIVERGED
        return bad | self._at_rest(ids)

    def _turn(self, ids: Int[np.ndarray, " active"], gaps: Float[np.ndarray, "active 2 3"]) -> None:
        """Undo motion that stretches the rope; stop where it no longer does, at the start, or at the end."""
        gap, way, progress = (gaps * gaps).sum(-1).max(-1), self._way[ids], self._progress[ids]
        arrived = (way == FORTH) & (progress >= self._limit[ids])
        eased = (way == BACK) & ((gap < (self.motion.stretch / 2) ** 2) | (progress <= 0.0))
        back = (gap > self.motion.stretch**2) & (progress > 0.0)
        self._outcome[ids[back]] = _STRETCH
        self._way[ids] = np.where(back, BACK, np.where(arrived | eased, REST, way))

    def _at_rest(self, ids: Int[np.ndarray, " active"]) -> Bool[np.ndarray, " active"]:
        late = (self._clock[ids] >= round(self.motion.patience / self._tick_s)) & (self._way[ids] == REST)
        return np.asarray((self._still[ids] >= REST_TICKS) | late)
