"""A world of one's own, and no rope in it: a robot that drives over dry ground, and slides where there is ice.

The model of driving is learned on dry ground. Ice is on the map, but no model knows what it does. So Fairlead learns
where the model can be trusted, and plans through that. A minute or two on two cores; ends with a picture.

    python examples/own_world.py [FOLDER]
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import final

import numpy as np
from matplotlib.axes import Axes

from fairlead.core.budget import Budget
from fairlead.core.layout import StateLayout
from fairlead.core.records import Executed, TrialOutcome, Transitions
from fairlead.core.roles import Dynamics, TransitionCheck
from fairlead.core.streams import stream
from fairlead.core.traces import Trace, read_trace
from fairlead.data.collect import CollectConfig, collect
from fairlead.execution.trace import TraceFolder
from fairlead.execution.trial import Protocol, Task, run_trial
from fairlead.geometry.fields import BoxEnvironment
from fairlead.geometry.goals import PointGoal
from fairlead.geometry.motion import RandomDisplacement
from fairlead.geometry.shapes import Box, Obstacle
from fairlead.learning.dynamics import DynamicsConfig
from fairlead.learning.fit import Stage
from fairlead.learning.registry import load_check, load_dynamics
from fairlead.learning.trust_network import TrustConfig
from fairlead.planning.checks import AcceptAll
from fairlead.planning.problem import Problem
from fairlead.planning.recovery import NoRecovery
from fairlead.planning.rrt import BatchedRRT
from fairlead.report.style import figure
from fairlead.reproduce import stages
from fairlead.scenarios.computed import ComputedWorld
from fairlead.scenarios.scenario import Scenario
from fairlead.scenarios.scene_files import GoalSpec, Scene

ROBOT = StateLayout(("robot",), points=0)


@final
class Ground(Scenario):
    """Four square metres. A state is where the robot is, an action where it is told to go."""

    name, layout = "ground", ROBOT

    def __init__(self) -> None:
        everywhere = np.array([np.inf, np.inf, 0.0])
        self.sampler = RandomDisplacement(ROBOT, 0.15, (-1.0, -1.0, 0.0), (1.0, 1.0, 0.0), planar=True)
        self.unconstrained_sampler = RandomDisplacement(ROBOT, 0.15, tuple(-everywhere), tuple(everywhere), planar=True)

    def environment(self, obstacles: Sequence[Obstacle]) -> BoxEnvironment:
        bounds = np.array([[-1.0, -1.0, -0.01], [1.0, 1.0, 0.01]])
        return BoxEnvironment([box for ice in obstacles for box in ice.boxes], bounds, resolution=0.02)

    def goal(self, scene: Scene) -> PointGoal:
        return PointGoal(ROBOT, 0, scene.goal.position, scene.goal.radius)

    def simulate(
        self, obstacles: Sequence[Sequence[Obstacle]], states: np.ndarray, threads: int = 1
    ) -> ComputedWorld:
        maps = [self.environment(ice) for ice in obstacles]

        def drive(copies: np.ndarray, positions: np.ndarray, targets: np.ndarray) -> Executed:
            """Long ways fall short on dry ground; on ice the wheels spin, whatever was asked."""
            wanted = targets - positions
            gone = wanted / (1 + 2 * np.linalg.norm(wanted, axis=1, keepdims=True))
            for _ in range(8):
                icy = np.array([maps[i].occupied(place) for i, place in zip(copies, positions, strict=True)])
                positions = positions + gone * np.where(icy[:, None], 0.02, 1.0) / 8
            return Executed(positions, np.ones(len(copies)), np.zeros(len(copies), int))

        return ComputedWorld(ROBOT, states, drive)

    def simulate_unconstrained(self, states: np.ndarray, threads: int = 1) -> ComputedWorld:
        return self.simulate([()] * len(states), states)

    def random_start(self, rng: np.random.Generator) -> np.ndarray:
        return np.array([*rng.uniform(-0.9, 0.9, 2), 0.0])

    def rearrange(
        self, states: np.ndarray, rngs: Sequence[np.random.Generator], threads: int = 1
    ) -> tuple[list[tuple[Obstacle, ...]], np.ndarray]:
        return [random_ice(rng) for rng in rngs], states

    def random_scene(self, rng: np.random.Generator, name: str) -> Scene:
        start, end = ((x, float(rng.uniform(-0.8, 0.8)), 0.0) for x in (-0.92, 0.92))
        return Scene(name, random_ice(rng), {"robot": start}, (), GoalSpec("robot", end, radius=0.05))


def random_ice(rng: np.random.Generator) -> tuple[Obstacle, ...]:
    """Five patches anywhere but at the left and right edge."""
    boxes = [Box((*rng.uniform(0.3, 0.6, 2), 1.0), (0.0, 0.0, 0.0)) for _ in range(5)]
    return tuple(Obstacle("ice", (box.moved((*rng.uniform((-0.5, -0.7), (0.5, 0.7)), 0.0), rng.uniform(0, np.pi)),)) for box in boxes)


def learn(ground: Ground, folder: Path, trajectories: int = 256) -> tuple[Dynamics, TransitionCheck]:
    """Drive on dry ground and learn a model; drive among ice and learn where it is right to 2 cm."""
    dry, icy, dynamics, trust = (folder / name for name in ("dry", "icy", "dynamics", "trust"))
    collect(ground, CollectConfig(phase=1, trajectories=trajectories), dry)
    collect(ground, CollectConfig(phase=2, trajectories=trajectories, obstacles_every=1), icy)
    stages.dynamics(ground, dry, DynamicsConfig("mlp", hidden=64, stages=(Stage(20, 128),)), dynamics, seed=0)
    stages.trust(ground, icy, dynamics, TrustConfig(delta_m=0.02, hidden=64, stages=(Stage(10, 256),)), trust, seed=0)
    return load_dynamics(dynamics, ground.name), load_check(trust, ground.name)


def drive(ground: Ground, scene: Scene, dynamics: Dynamics, check: TransitionCheck, seed: int = 0) -> Trace:
    """Plan, execute, look, and plan again until the robot is there or has considered 4000 moves."""
    environment, goal = ground.environment(scene.obstacles), ground.goal(scene)
    problem, planner = Problem(environment, goal, dynamics, check, ground.sampler), BatchedRRT()
    task = Task(environment, goal, lambda state, meter, rng: planner.plan(problem, state, meter, rng), NoRecovery())
    world = ground.simulate([scene.obstacles], scene.state(ROBOT)[None])
    with TemporaryDirectory() as folder:
        run_trial(world, task, Budget(extensions=20000), Protocol.FAIR, seed, TraceFolder(Path(folder), {}))
        return read_trace(Path(folder))


def trust_at(
    ground: Ground, scene: Scene, dynamics: Dynamics, check: TransitionCheck, places: np.ndarray
) -> np.ndarray:
    """The mean trust in 16 random moves from each place."""
    environment, states = ground.environment(scene.obstacles), np.repeat(places, 16, axis=0)
    actions = ground.sampler.propose(states, stream(0, "map"))
    found = dynamics.predict(environment, states, actions)
    moves = Transitions(states, actions, found.mean, found.spread)
    encodings = check.encode(environment, states), check.encode(environment, found.mean)
    return check.probability(environment, moves, *encodings).reshape(len(places), 16).mean(axis=1)


def main(folder: Path) -> None:
    """Learn, drive in ten scenes with and without trust, draw the first that tells them apart."""
    ground = Ground()
    dynamics, check = learn(ground, folder)
    checks = {"trust": check, "accept-all": AcceptAll()}
    scenes = [ground.random_scene(stream(1, i), f"scene-{i}") for i in range(20)]
    traces = {name: [drive(ground, s, dynamics, c) for s in scenes] for name, c in checks.items()}
    for name, t in traces.items():
        print(name, sum(x.outcome is TrialOutcome.GOAL for x in t), [len(x.actions) for x in t])


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "runs/own_world"))
