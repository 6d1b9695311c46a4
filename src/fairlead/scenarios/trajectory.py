"""A plan as a time-stamped trajectory of grippers and joints, for a robot's own player: CSV or JSON.

The first row is the posture to start from. Between rows everything moves in straight lines of joint angles (of gripper
positions where there are no arms), and rests after each action: the models know an object at rest. A row's speeds are
within limits; accelerations are the player's business.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from jaxtyping import Float

from fairlead.core.artifacts import write_atomic
from fairlead.core.errors import FairleadError
from fairlead.core.records import ActionOutcome
from fairlead.core.traces import Trace
from fairlead.geometry.fields import BoxEnvironment
from fairlead.scenarios.arms import Arms
from fairlead.scenarios.scenario import Scenario
from fairlead.scenarios.scene_files import Scene

REST_S, LEAST_S = 0.5, 1e-3
"""Rest after each action, and the least time between two rows [s]."""
DIGITS = 6
"""Micrometres, microradians; times are whole microseconds."""
TICKS = 1_000_000
_SUFFIXES = (".csv", ".json")


@final
@dataclass(frozen=True)
class Trajectory:
    """Rows of `columns`: `time_s`, `action` (0 at the start, then the number of the action that is carried out),
    `NAME_x_m`, `NAME_y_m`, `NAME_z_m` of each gripper in the world's frame, and `NAME_rad` of each joint.

    `about` says whose plan it is and where it ends.
    """

    columns: tuple[str, ...]
    rows: Float[np.ndarray, "row column"]
    about: Mapping[str, Any]

    def write(self, path: Path) -> None:
        """Write CSV (rows alone) or JSON (with what it is about), whole or not at all."""
        require_format(path)
        rows = [[time, int(action), *places] for time, action, *places in self.rows.tolist()]
        if path.suffix.lower() == ".json":
            units = [_unit(name) for name in self.columns]
            content = json.dumps({**self.about, "columns": self.columns, "units": units, "rows": rows}) + "\n"
        else:
            text = io.StringIO()
            csv.writer(text, lineterminator="\n").writerows([self.columns, *rows])
            content = text.getvalue()
        write_atomic(path, content)


def require_format(path: Path) -> None:
    """Raise FairleadError where a file's name ends in neither `.csv` nor `.json`."""
    if path.suffix.lower() not in _SUFFIXES:
        raise FairleadError(f"{path}: a trajectory is written as {' or '.join(_SUFFIXES)}")


def planned(scenario: Scenario, scene: Scene, trace: Trace) -> Trajectory:
    """The first plan of a trial, as predicted; "plan" is its number, "recovered" counts the recovery actions before it.

    "outcome" says whether it ends in the goal, or is partial: as near to the goal as planning came in time.

    Raises:
        FairleadError: every planning attempt was stuck.
    """
    for plan in trace.plans:
        if len(plan.actions):
            recovered = sum(action.plan < plan.index for action in trace.actions)
            about = {**trace.about, "plan": plan.index, "outcome": plan.outcome.label, "recovered": recovered}
            return trajectory(scenario, scene, plan.states[0], plan.actions, about)
    raise FairleadError(f"scene '{scene.name}': every planning attempt was stuck, so there is no plan to export")


def trajectory(
    scenario: Scenario,
    scene: Scene,
    start: Float[np.ndarray, " state"],
    actions: Float[np.ndarray, "steps action"],
    about: Mapping[str, Any],
) -> Trajectory:
    """What grippers and arms do to carry out a plan from `start`.

    The arms grasp the grippers of the start, and follow each action from where the last one has left them. Where they
    are stopped, the trajectory ends: "ends" names the reason, "actions_done" the whole actions before it.
    """
    layout, arms = scenario.layout, scenario.arms
    at = layout.grippers_of(np.asarray(start, float)).round(DIGITS)
    joints = np.zeros((len(at), 0)) if arms is None else _settable(arms, arms.grasp(at[None])[0][0])
    ticks, done, ends = 0, 0, ActionOutcome.TARGET
    rows = [_row(ticks, 0, at, joints)]
    for number, target in enumerate(layout.grippers_of(np.asarray(actions, float)).round(DIGITS), 1):
        places, postures, ends = _followed(scenario, scene, at, joints, target)
        for place, posture in zip(places[1:], postures[1:], strict=True):
            ticks += _ticks(scenario, place - at, posture - joints)
            at, joints = place, posture
            rows.append(_row(ticks, number, at, joints))
        if ends is not ActionOutcome.TARGET:
            break
        done = number
        ticks += round(REST_S * TICKS)
        rows.append(_row(ticks, number, at, joints))
    names = () if arms is None else tuple(f"{name}_rad" for arm in arms.kinematics.names for name in arm)
    grippers = (f"{name}_{axis}_m" for name in layout.grippers for axis in "xyz")
    told = {**about, "actions": len(actions), "actions_done": done, "ends": ends.label, **_limits(scenario)}
    return Trajectory(("time_s", "action", *grippers, *names), np.array(rows) + 0.0, told)


def _followed(
    scenario: Scenario, scene: Scene, at: np.ndarray, joints: np.ndarray, target: np.ndarray
) -> tuple[np.ndarray, np.ndarray, ActionOutcome]:
    """Waypoints of the grippers (waypoint, gripper, 3) and postures there, as far as the arms come, and why so far."""
    if scenario.arms is None:
        return np.stack([at, target]), np.stack([joints, joints]), ActionOutcome.TARGET
    environment = scenario.environment(scene.obstacles)
    if not isinstance(environment, BoxEnvironment):
        raise FairleadError("what the arms can do is known in an environment made of boxes only")
    path = scenario.arms.follow(joints[None], at[None], target[None], [environment.boxes])
    kept, parts = slice(None, int(path.reached[0]) + 1), path.joints.shape[1] - 1
    line = (at + np.linspace(0.0, 1.0, parts + 1)[:, None, None] * (target - at)).round(DIGITS)
    postures = _settable(scenario.arms, path.joints[0])
    return line[kept], postures[kept], tuple(ActionOutcome)[int(path.outcomes[0])]


def _settable(arms: Arms, joints: np.ndarray) -> np.ndarray:
    """Postures as they are written: rounded, and within limits, beyond which they may be by a rounding error."""
    low, high = (limit[..., 0].T for limit in (arms.kinematics.low, arms.kinematics.high))
    return np.clip(joints.round(DIGITS), low, high)


def _ticks(scenario: Scenario, moved: np.ndarray, turned: np.ndarray) -> int:
    """The shortest time [us] in which no gripper and no joint is faster than it may be."""
    seconds = max(LEAST_S, float(np.linalg.norm(moved, axis=-1).max()) / scenario.gripper_speed)
    if scenario.arms is not None:
        seconds = max(seconds, float((np.abs(turned) / scenario.arms.speed_limits).max()))
    return math.ceil(seconds * TICKS)


def _row(ticks: int, action: int, grippers: np.ndarray, joints: np.ndarray) -> np.ndarray:
    return np.concatenate([[ticks / TICKS, action], grippers.ravel(), joints.ravel()])


def _limits(scenario: Scenario) -> dict[str, Any]:
    """What the time stamps follow from."""
    arms = scenario.arms
    limits = {} if arms is None else {"joint_speed_limits_rad_per_s": arms.speed_limits.tolist()}
    between = "straight lines in the columns of " + ("grippers" if arms is None else "joints")
    return {"gripper_speed_m_per_s": scenario.gripper_speed, **limits, "rest_s": REST_S, "between_rows": between}


def _unit(column: str) -> str:
    """The unit that a column's name ends in; actions are counted."""
    return "1" if column == "action" else column.rpartition("_")[2]
