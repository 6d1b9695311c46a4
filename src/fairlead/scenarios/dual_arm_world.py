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
from fairlead.core.records import ActionOutcome, Executed
from fairlead.geometry.shapes import Box, Obstacle
from fairlead.scenarios.arms import PARTS, Arms
from fairlead.scenarios.hanging_rope import SIDES, HangingRope
from fairlead.scenarios.obstacles import Sizes, add_boxes, box_poses, box_sizes
from fairlead.scenarios.rope import OBSTACLE_BIT
from fairlead.scenarios.simulate import SimulatedWorld, Simulation, base_options

LAYOUT = StateLayout(("left_gripper", "right_gripper"), 25)
TABLE = Box((0.8, 1.5, 0.12), (0.8, 0.0, 0.565))
_TARGET, _STRETCH, _DIVERGED = map(
    tuple(ActionOutcome).index, (ActionOutcome.TARGET, ActionOutcome.STRETCH, ActionOutcome.DIVERGED)
)


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
class DualArmWorld(SimulatedWorld):
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
        model = build_model(sizes, rope)
        count = len(states)
        self.rope, self.motion, self.arms = rope, motion, arms
        self.simulation = Simulation(model, count, threads)
        batch = self.simulation.batch
        self._mocap, self._sites = batch.bind("mocap_pos"), batch.bind("site_xpos")
        if obstacles is not None and sizes:
            self._mocap[:, len(SIDES) :], batch.mocap_quat[:, len(SIDES) :] = box_poses(obstacles, sizes)
        self._boxes = [[TABLE, *(box for o in row for box in o.boxes)] for row in obstacles or ((),) * count]
        self._points = np.array([model.site(f"point{i}").id for i in range(rope.links)])
        self._ends = np.array([model.site(f"{side}_end").id for side in SIDES])
        self._holds = np.array([model.site(side).id for side in SIDES])
        self._tick = motion.substeps * model.opt.timestep
        self._decay = float(np.exp(-self._tick / motion.damping))
        self._active = np.empty(0, np.int32)
        self._from, self._to = np.zeros((2, count, 2, 3))
        self._progress, self._limit, self._pace, self._clock = np.zeros((4, count))
        self._way, self._still, self._outcome = np.zeros((3, count), int)
        self._before, self._where = np.zeros_like(self.simulation.qpos), np.zeros((count, rope.links, 3))
        self._warm = batch.bind("qacc_warmstart")
        self.place(states)
        gap = LAYOUT.points_of(self.observe()) - LAYOUT.points_of(states)
        self._residual = np.where(self._unsound, np.inf, np.sqrt((gap * gap).sum(-1).mean(-1)))

    def place(self, states: Float[np.ndarray, "batch state"]) -> None:
        """Lay every rope along the given points, held and at rest, and let it settle; the arms grasp its ends.

        Where that diverges the rope stays as laid, and the next action ends as diverged.
        """
        everyone = np.arange(len(states), dtype=np.int32)
        grippers = LAYOUT.grippers_of(states)
        qpos = self.rope.joint_positions(grippers, LAYOUT.points_of(states))
        self.simulation.qpos[:], self.simulation.qvel[:] = qpos, 0.0
        self._mocap[:, : len(SIDES)] = self._from[:] = self._to[:] = grippers
        self._joints = np.zeros((len(states), len(SIDES), 0)) if self.arms is None else self.arms.grasp(grippers)[0]
        self._path = np.repeat(self._joints[:, None], PARTS + 1, axis=1)
        self._begin(everyone, np.zeros(len(states)), np.zeros(len(states)))
        left, self._unsound = everyone, np.zeros(len(states), bool)
        while len(left):
            self._advance(left)
            self._unsound[left] = self.simulation.diverged(left)
            left = left[~self._ended(left) & ~self._unsound[left]]
        self._stop(everyone, self._unsound, qpos)

    @property
    def layout(self) -> StateLayout:
        return LAYOUT

    @property
    def residual(self) -> Float[np.ndarray, " batch"]:
        return self._residual

    @property
    def steps(self) -> int:
        return self.simulation.steps

    def observe(self) -> Float[np.ndarray, "batch state"]:
        return self._observe(np.arange(len(self._clock), dtype=np.int32))

    def _observe(self, ids: Int[np.ndarray, " some"]) -> Float[np.ndarray, "some state"]:
        self.simulation.batch.forward(ids, stage=mujoco.mjtStage.mjSTAGE_POS.value)
        return LAYOUT.join(self._mocap[ids, : len(SIDES)], self._sites[np.ix_(ids, self._points)])

    def send(self, ids: Int[np.ndarray, " some"], actions: Float[np.ndarray, "some action"]) -> None:
        self._before[ids] = self.simulation.qpos[ids]
        self._from[ids] = start = self._mocap[ids, : len(SIDES)]
        self._to[ids] = target = actions.reshape(len(ids), len(SIDES), 3)
        limit, outcome = np.ones(len(ids)), np.full(len(ids), _TARGET)
        seconds = np.linalg.norm(target - start, axis=-1).max(axis=1) / self.motion.speed
        if self.arms is not None:
            path = self.arms.follow(self._joints[ids], start, target, [self._boxes[i] for i in ids], PARTS)
            self._path[ids] = path.joints
            limit, outcome = path.reached / PARTS, path.outcomes
            seconds = np.maximum(seconds * limit, path.seconds)
        self._begin(ids, limit, seconds)
        self._outcome[ids] = outcome
        self._active = np.union1d(self._active, ids).astype(np.int32)

    def _begin(self, ids: Int[np.ndarray, " some"], limit: np.ndarray, seconds: np.ndarray) -> None:
        """Start the clocks of motions up to a fraction `limit` of the way that take so many seconds."""
        self._progress[ids], self._clock[ids], self._still[ids] = 0.0, 0.0, 0
        self._limit[ids], self._pace[ids], self._way[ids] = limit, limit / np.maximum(seconds, self._tick), FORTH

    def receive(self) -> tuple[Int[np.ndarray, " some"], Executed]:
        """Move the grippers until a stop or the target, then wait for the rope to come to rest."""
        self.check_sent(len(self._active))
        ended = np.zeros(len(self._active), bool)
        while not ended.any():
            self._advance(self._active)
            bad = self._unsound[self._active] | self.simulation.diverged(self._active)
            self._outcome[self._active[bad]] = _DIVERGED
            ended = bad | self._ended(self._active)
        ids, self._active = self._active[ended], self._active[~ended]
        self._stop(ids, self._outcome[ids] == _DIVERGED, self._before[ids])
        return ids, Executed(self._observe(ids), self._clock[ids], self._outcome[ids])

    def carry(self, ids: Int[np.ndarray, " some"], targets: Float[np.ndarray, "some action"]) -> Executed:
        """One action of some copies alone; the others rest."""
        self.send(ids, targets)
        done: list[tuple[np.ndarray, Executed]] = []
        while len(self._active):
            done.append(self.receive())
        order = np.argsort(np.concatenate([got for got, _ in done]))
        parts = [np.concatenate([getattr(e, f) for _, e in done])[order] for f in ("states", "seconds", "outcomes")]
        return Executed(*parts)

    def _advance(self, ids: Int[np.ndarray, " active"]) -> None:
        """One tick of each copy: move the grippers, damp the rope, and turn back where it is stretched."""
        simulation, count = self.simulation, self.motion.substeps
        begun = self._progress[ids]
        ended = np.clip(begun + self._way[ids] * self._pace[ids] * self._tick, 0.0, self._limit[ids])
        start, way = self._from[ids], self._to[ids] - self._from[ids]
        for k in range(1, count + 1):
            fraction = begun + (ended - begun) * (k / count)
            self._mocap[ids, : len(SIDES)] = start + fraction[:, None, None] * way
            simulation.step(ids)
        simulation.qvel[ids] *= self._decay
        self._progress[ids], self._clock[ids] = ended, self._clock[ids] + self._tick
        sites = self._sites[ids]
        self._turn(ids, sites[:, self._ends] - sites[:, self._holds])
        moved = sites[:, self._points] - self._where[ids]
        self._where[ids] = sites[:, self._points]
        still = (moved * moved).sum(-1).max(-1) < (self.motion.rest_speed * self._tick) ** 2
        self._still[ids] = np.where(still & (self._way[ids] == REST), self._still[ids] + 1, 0)

    def _turn(self, ids: Int[np.ndarray, " active"], gaps: Float[np.ndarray, "active 2 3"]) -> None:
        """Undo motion that stretches the rope; stop where it no longer does, at the start, or at the end."""
        gap, way, progress = (gaps * gaps).sum(-1).max(-1), self._way[ids], self._progress[ids]
        arrived = (way == FORTH) & (progress >= self._limit[ids])
        eased = (way == BACK) & ((gap < (self.motion.stretch / 2) ** 2) | (progress <= 0.0))
        back = (gap > self.motion.stretch**2) & (progress > 0.0)
        self._outcome[ids[back]] = _STRETCH
        self._way[ids] = np.where(back, BACK, np.where(arrived | eased, REST, way))

    def _ended(self, ids: Int[np.ndarray, " active"]) -> Bool[np.ndarray, " active"]:
        late = (self._clock[ids] > self.motion.patience) & (self._way[ids] == REST)
        return np.asarray((self._still[ids] >= REST_TICKS) | late)

    def _stop(
        self, ids: Int[np.ndarray, " some"], bad: Bool[np.ndarray, " some"], safe: Float[np.ndarray, "some position"]
    ) -> None:
        """Drop what is left of the velocity; copies that diverged go back to a safe position."""
        simulation, lost = self.simulation, ids[bad]
        simulation.qpos[lost], self._warm[lost] = safe[bad], 0.0
        simulation.qvel[ids] = 0.0
        self._mocap[lost, : len(SIDES)], self._progress[lost] = self._from[lost], 0.0
        at = self._progress[ids] * PARTS
        low = np.minimum(at.astype(int), PARTS - 1)
        fraction = (at - low)[:, None, None]
        self._joints[ids] = (1 - fraction) * self._path[ids, low] + fraction * self._path[ids, low + 1]
