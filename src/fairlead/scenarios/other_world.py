"""Execution in a world other than that of training: another rope, imprecise grippers and sensing, misplaced obstacles.

A trial's world is made here, behind the `World` role, as a robot's driver would be. Nothing that plans or learns knows,
but for the arms: a robot knows itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, final

import numpy as np
from jaxtyping import Float

from fairlead.core.errors import FairleadError
from fairlead.core.layout import StateLayout
from fairlead.core.records import Executed
from fairlead.core.roles import World
from fairlead.geometry.shapes import Obstacle
from fairlead.scenarios.arms import Arms
from fairlead.scenarios.panda import dual_panda
from fairlead.scenarios.rope import RopeFactors
from fairlead.scenarios.scenario import Scenario
from fairlead.scenarios.simulate import SimulatedWorld

ARMS: dict[str, Callable[[], Arms | None]] = {"same": lambda: None, "panda": dual_panda}


@dataclass(frozen=True)
class Differences:
    """How the world of execution differs from that of training; the defaults are no difference.

    Args:
        mass, friction, damping, length: of the rope, as factors.
        stiffness: of each joint of the rope [N m / rad]; there is none in training.
        tracking_m: a gripper sent to a target goes to one this far off, standard deviation of each coordinate [m].
        sensing_m: noise of each coordinate of an observed rope point, standard deviation [m].
        delay_s: an action starts so long after it was sent [s].
        misplaced_m: obstacles stand up to so far from where planning sees them, horizontally [m].
        arms: what carries the grippers where arms do, one of `ARMS`; planning knows them, as a robot knows itself.
    """

    mass: float = 1.0
    friction: float = 1.0
    damping: float = 1.0
    length: float = 1.0
    stiffness: float = 0.0
    tracking_m: float = 0.0
    sensing_m: float = 0.0
    delay_s: float = 0.0
    misplaced_m: float = 0.0
    arms: str = "same"

    def __post_init__(self) -> None:
        if self.arms not in ARMS:
            raise FairleadError(f"difference arms {self.arms}: allowed: {', '.join(ARMS)}")
        for name, value in self._numbers().items():
            least = "positive" if name in ("mass", "friction", "damping", "length") else "0 or more"
            if not np.isfinite(value) or value < 0 or (value == 0 and least == "positive"):
                raise FairleadError(f"difference {name} {value}: a number that is {least} is needed")

    @classmethod
    def parse(cls, text: str) -> Differences:
        """`friction=0.5,mass=2`, what is not named staying as in training; or `mockup`, those of the mock-ups."""
        if text == "mockup":
            return MOCKUP
        known = [field.name for field in fields(cls)]
        found: dict[str, Any] = {}
        for part in text.split(","):
            name, _, value = part.strip().partition("=")
            if name not in known:
                raise FairleadError(f"unknown difference '{name}'; allowed: mockup, {', '.join(known)}")
            if name in found:
                raise FairleadError(f"difference '{name}' is given twice")
            try:
                found[name] = value if name == "arms" else float(value)
            except ValueError:
                raise FairleadError(f"difference '{part}': a number is needed after '{name}='") from None
        return cls(**found)

    def _numbers(self) -> dict[str, float]:
        return {name: value for name, value in asdict(self).items() if name != "arms"}

    def __str__(self) -> str:
        """What differs, as `parse` reads it."""
        nothing = Differences()
        changed = {k: v for k, v in asdict(self).items() if v != getattr(nothing, k)}
        return ",".join(f"{k}={v if k == 'arms' else format(v, '.15g')}" for k, v in changed.items())


MOCKUP = Differences(mass=1.5, friction=0.7, damping=2.0, length=1.02, stiffness=0.002, tracking_m=0.003,
                     sensing_m=0.003, delay_s=0.1, misplaced_m=0.005, arms="panda")  # fmt: skip
"""The world in which the mock-ups of the real tasks are carried out: every difference at once."""


def with_arms_of(scenario: Scenario, differences: Differences | None) -> Scenario:
    """The scenario that is planned in: a robot knows its own arms, and nothing else of what differs."""
    arms = None if differences is None else ARMS[differences.arms]()
    return scenario if arms is None else scenario.altered(RopeFactors(), arms)


def other_world(
    scenario: Scenario,
    obstacles: Sequence[Obstacle],
    start: Float[np.ndarray, " state"],
    differences: Differences,
    rng: np.random.Generator,
) -> OtherWorld:
    """One copy of a world that differs from what is planned in.

    Raises:
        FairleadError: the scenario's rope cannot be altered.
    """
    d = differences
    altered = scenario.altered(RopeFactors(d.mass, d.friction, d.damping, d.length, d.stiffness), ARMS[d.arms]())
    placed = [misplaced(obstacle, d.misplaced_m, rng) for obstacle in obstacles]
    return OtherWorld(altered.simulate([placed], start[None]), d, rng)


def misplaced(obstacle: Obstacle, most: float, rng: np.random.Generator) -> Obstacle:
    """Shifted to a random place of a disc."""
    radius, heading = most * np.sqrt(rng.random()), rng.uniform(-np.pi, np.pi)
    shift = (radius * np.cos(heading), radius * np.sin(heading), 0.0)
    boxes = (replace(box, position=tuple(np.add(box.position, shift).tolist())) for box in obstacle.boxes)
    return Obstacle(obstacle.name, tuple(boxes))


@final
class OtherWorld(World):
    """A simulated world seen through noise and acted upon imprecisely. What was seen stays so until the next action.

    A trial knows no other truth: like a robot's, its success and its error are those that were sensed.
    """

    def __init__(self, inner: SimulatedWorld, differences: Differences, rng: np.random.Generator) -> None:
        self.inner, self._differences, self._rng = inner, differences, rng
        self._seen = self._sensed(inner.observe())

    @property
    def layout(self) -> StateLayout:
        return self.inner.layout

    def observe(self) -> Float[np.ndarray, "batch state"]:
        return self._seen.copy()

    def execute(self, actions: Float[np.ndarray, "batch action"]) -> Executed:
        reached_for = actions + self._rng.normal(0.0, self._differences.tracking_m, actions.shape)
        done = self.inner.execute(reached_for)
        self._seen = self._sensed(done.states)
        return Executed(self.observe(), done.seconds + self._differences.delay_s, done.outcomes)

    def _sensed(self, states: Float[np.ndarray, "batch state"]) -> Float[np.ndarray, "batch state"]:
        """With noise on the rope points; where the grippers are, is known from the joints."""
        seen = states.copy()
        points = self.layout.points_of(seen)
        points += self._rng.normal(0.0, self._differences.sensing_m, points.shape)
        return seen
