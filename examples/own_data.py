"""Learning from what one's own robot did: record its moves, learn a model, learn where that can be trusted, use both.

The robot of own_robot.py, and now it bumps into what is in its way. `python examples/own_data.py [FOLDER]` takes
half a minute; a real robot takes as long as its moves do.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import final

import numpy as np
from own_robot import HIGH, LAYOUT, LOW, MOVES, POST, FakeDriver, RobotWorld, trial

from fairlead.core.records import Trajectories
from fairlead.core.roles import Environment
from fairlead.execution.trial import TrialResult
from fairlead.geometry.fields import BoxEnvironment
from fairlead.geometry.shapes import Box
from fairlead.learning.dynamics import DynamicsConfig, train_dynamics
from fairlead.learning.fit import Stage
from fairlead.learning.model_files import Job
from fairlead.learning.rollout import Splits
from fairlead.learning.trust import train_trust
from fairlead.learning.trust_network import TrustConfig

NOTHING = BoxEnvironment([], np.array([LOW, HIGH]))
STEPS, DELTA_M = 16, 0.02


@final
class BumpingDriver(FakeDriver):
    """Hand and marker stop at what is in their way."""

    def __init__(self, around: Environment) -> None:
        super().__init__()
        self.around = around

    def move_to(self, target: np.ndarray, timeout_s: float) -> bool:
        way = self.hand + np.linspace(0, 0.9, 30)[:, None] * (target - self.hand)
        hit = (self.around.occupied(way) | self.around.occupied(way - (0.0, 0.0, 0.2))).tolist()
        self.hand = way[max(hit.index(True) - 1, 0)] if any(hit) else way[-1]
        return not any(hit)


def posts(rng: np.random.Generator) -> Environment:
    """Four posts somewhere, none where the robot starts."""
    while True:
        boxes = [Box((*rng.uniform(0.1, 0.4, 3),), (*rng.uniform(LOW, HIGH),)) for _ in range(4)]
        around = BoxEnvironment(boxes, np.array([LOW, HIGH]))
        if not around.occupied(FakeDriver().see().reshape(-1, 3)).any():
            return around


def record(places: list[Environment], rng: np.random.Generator) -> Trajectories:
    """A trajectory in each place: random moves, one after the other."""
    states = np.empty((len(places), STEPS + 1, LAYOUT.state_size), np.float32)
    actions = np.empty((len(places), STEPS, LAYOUT.action_size), np.float32)
    outcomes = np.empty((len(places), STEPS), int)
    for row, around in enumerate(places):
        world = RobotWorld(BumpingDriver(around))
        states[row, 0] = world.observe()[0]
        for step in range(STEPS):
            action = MOVES.propose(world.observe(), rng)
            executed = world.execute(action)
            states[row, step + 1], actions[row, step] = executed.states[0], action[0]
            outcomes[row, step] = executed.outcomes[0]
    return Trajectories(LAYOUT, states, actions, outcomes, np.arange(len(places)), places)


def main(folder: Path, trajectories: int = 200) -> TrialResult:
    """Record, learn, and go around the post with what was learned."""
    rng = np.random.default_rng(0)
    counts = (trajectories, trajectories // 4, trajectories // 4)  # to learn from, to choose by, to judge by
    free = Splits(*(record([NOTHING] * count, rng) for count in counts))
    among = Splits(*(record([posts(rng) for _ in range(count)], rng) for count in counts))
    model = DynamicsConfig("mlp", hidden=64, planar=False, stages=(Stage(30, batch=128),))
    dynamics = train_dynamics(free, model, Job(folder / "dynamics", "own-robot"))
    trust = TrustConfig(planar=False, hidden=16, augment=False, stages=(Stage(20, batch=128),))
    check = train_trust(dynamics, among, DELTA_M, trust, Job(folder / "trust", "own-robot"))
    return trial(RobotWorld(BumpingDriver(POST)), dynamics, check)


if __name__ == "__main__":
    result = main(Path(sys.argv[1] if len(sys.argv) > 1 else "runs/own_data"))
    print(f"{result.outcome.label}: {result.error_m:.3f} m from the goal's middle after {result.actions} actions.")
