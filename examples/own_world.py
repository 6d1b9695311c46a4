"""A world of one's own, and no rope in it: a robot drives over dry ground, and its wheels spin where there is ice.

Its model is learned on dry ground. Ice is on the map, but the model does not know what ice does. Learned besides is
where the model can be trusted, and plans lead through that alone. `python examples/own_world.py [FOLDER]` takes
a minute or two, counts how often the robot arrives with trust and without, and draws why.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import final

import numpy as np
from matplotlib.axes import Axes

from fairlead.core.budget import Budget
from fairlead.core.layout import StateLayout
from fairlead.core.records import Executed
from fairlead.core.roles import TransitionCheck
from fairlead.core.streams import stream
from fairlead.core.traces import Trace, read_trace
from fairlead.data.collect import CollectConfig, collect
from fairlead.execution.trace import TraceFolder
from fairlead.execution.trial import Protocol, Task, run_trial
from fairlead.geometry.fields import BoxEnvironment
from fairlead.geometry.goals import point_goal
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
from fairlead.report.drawing import arena, draw_goal, outlines
from fairlead.report.style import INK, MUTED, PAPER, figure
from fairlead.report.video import TRUST
from fairlead.reproduce import stages
from fairlead.scenarios.computed import ComputedWorld
from fairlead.scenarios.scenario import Scenario
from fairlead.scenarios.scene_files import Scene

ROBOT = StateLayout(("robot",), points=0)
"""A state is where the robot is, an action where it is told to go."""


@final
class Ground(Scenario):
    """Four square metres with patches of ice."""

    name, layout = "ground", ROBOT
    sampler = unconstrained_sampler = RandomDisplacement(ROBOT, 0.15, (-1.0, -1.0, 0.0), (1.0, 1.0, 0.0), planar=True)

    def environment(self, obstacles: Sequence[Obstacle]) -> BoxEnvironment:
        bounds = np.array([[-1.0, -1.0, -0.01], [1.0, 1.0, 0.01]])
        return BoxEnvironment([box for ice in obstacles for box in ice.boxes], bounds)

    def simulate(self, obstacles: Sequence[Sequence[Obstacle]], states: np.ndarray, threads: int = 1) -> ComputedWorld:
        maps = [self.environment(ice) for ice in obstacles]

        def drive(ids: np.ndarray, places: np.ndarray, targets: np.ndarray) -> Executed:
            """Long ways fall short on dry ground; on ice the robot gets nowhere."""
            wanted = targets - places
            gone = wanted / (1 + 2 * np.linalg.norm(wanted, axis=1, keepdims=True))
            for _ in range(4):
                icy = np.array([maps[i].occupied(place) for i, place in zip(ids, places, strict=True)])
                places = places + gone / 4 * np.where(icy, 0.01, 1.0)[:, None]
            return Executed(places, seconds=np.ones(len(ids)), outcomes=np.zeros(len(ids), int))

        return ComputedWorld(ROBOT, states, drive)

    def simulate_unconstrained(self, states: np.ndarray, threads: int = 1) -> ComputedWorld:
        return self.simulate([()] * len(states), states)

    def random_start(self, rng: np.random.Generator) -> np.ndarray:
        return np.array([*rng.uniform(-0.9, 0.9, 2), 0.0])

    def random_ice(self, rng: np.random.Generator) -> tuple[Obstacle, ...]:
        """Five patches that leave the left and the right edge dry."""
        patches = [Box((*rng.uniform(0.3, 0.6, 2), 0.4), (0.0, 0.0, 0.0)) for _ in range(5)]
        turned = [p.moved((*rng.uniform((-0.5, -0.7), (0.5, 0.7)), 0.0), rng.uniform(0, np.pi)) for p in patches]
        return tuple(Obstacle("ice", (patch,)) for patch in turned)

    def rearrange(
        self, states: np.ndarray, rngs: Sequence[np.random.Generator], threads: int = 1
    ) -> tuple[list[tuple[Obstacle, ...]], np.ndarray]:
        return [self.random_ice(rng) for rng in rngs], states

    def random_scene(self, rng: np.random.Generator, name: str) -> Scene:
        start, end = ((x, float(rng.uniform(-0.8, 0.8)), 0.0) for x in (-0.92, 0.92))
        return Scene(name, self.random_ice(rng), {"robot": start}, (), point_goal(ROBOT, "robot", end, 0.05))


def learn(ground: Ground, folder: Path, count: int) -> None:
    """Drive on dry ground and learn a model; drive among ice and learn where that model is right to 2 cm."""
    collect(ground, CollectConfig(1, count), folder / "dry")
    collect(ground, CollectConfig(2, count, obstacles_every=1), folder / "icy")
    model = DynamicsConfig("mlp", hidden=64, stages=(Stage(20, batch=128),))
    stages.dynamics(ground, folder / "dry", model, folder / "dynamics", seed=0)
    trust = TrustConfig(hidden=64, delta_m=0.02, stages=(Stage(10, batch=256),))
    stages.trust(ground, folder / "icy", folder / "dynamics", trust, folder / "trust", seed=0)


def problem(ground: Ground, scene: Scene, folder: Path, check: TransitionCheck) -> Problem:
    """Where, whereto, with which model, and whom to trust."""
    dynamics = load_dynamics(folder / "dynamics", ground.name)
    return Problem(ground.environment(scene.obstacles), scene.goal, dynamics, check, ground.sampler)


def drive(ground: Ground, scene: Scene, problem: Problem) -> Trace:
    """Plan, execute, look and plan again, until the robot is there or 10,000 moves were considered."""
    task = Task(problem.environment, problem.goal, partial(BatchedRRT().plan, problem), NoRecovery())
    world = ground.simulate([scene.obstacles], scene.state(ROBOT)[None])
    with TemporaryDirectory() as folder:
        run_trial(world, task, Budget(extensions=10_000), Protocol.FAIR, 0, TraceFolder(Path(folder), {}))
        return read_trace(Path(folder))


def trust_at(problem: Problem, places: np.ndarray) -> np.ndarray:
    """The mean trust in 16 random moves from each place."""
    states = np.repeat(places, 16, axis=0)
    moves = problem.sampler.propose(states, stream(0, "map"))
    tried = problem.attempt(states, moves, problem.check.encode(problem.environment, states))
    return tried.trust.reshape(-1, 16).mean(axis=1)


def draw(axes: Axes, problem: Problem, scene: Scene, trace: Trace) -> None:
    """The trust everywhere, the ice, the first plan, and the way that was driven."""
    side = np.linspace(-1, 1, 101)
    places = np.stack([*np.meshgrid(side, side), np.zeros((101, 101))], axis=-1).reshape(-1, 3)
    arena(axes, np.zeros(2), 1.0)
    axes.imshow(trust_at(problem, places).reshape(101, 101), TRUST, origin="lower", extent=(-1, 1, -1, 1), alpha=0.5)
    for patch in outlines(scene.written()["obstacles"]):
        axes.fill(*patch.T, facecolor="none", edgecolor="white", hatch="//", linewidth=1.2)
    driven = np.array([trace.start, *(action.state for action in trace.actions)])
    axes.plot(*driven.T[:2], ".-", color=INK, linewidth=3, label="driven")
    axes.plot(*trace.plans[0].states.T[:2], ":", color=PAPER, linewidth=1.5, label="first plan")
    draw_goal(axes, scene.goal.written())


def main(folder: Path, trajectories: int = 256, trials: int = 10) -> dict[str, list[bool]]:
    """Learn, drive with trust and without it, and draw the first scene that tells them apart; where each arrived."""
    ground = Ground()
    learn(ground, folder, trajectories)
    scenes = [ground.random_scene(stream(1, i), f"scene-{i}") for i in range(trials)]
    checks = {"trust": load_check(folder / "trust", ground.name), "accept all": AcceptAll()}
    problems = {name: [problem(ground, scene, folder, check) for scene in scenes] for name, check in checks.items()}
    traces = {name: list(map(partial(drive, ground), scenes, posed)) for name, posed in problems.items()}
    arrived = {name: [trace.result["success"] for trace in driven] for name, driven in traces.items()}
    shown = int(np.argmax([a - b for a, b in zip(*arrived.values(), strict=True)]))
    with figure(8.8, 4.1, columns=2) as (canvas, axes):
        for place, name in zip(axes, checks, strict=True):
            draw(place, problems["trust"][shown], scenes[shown], traces[name][shown])
            place.set_title(f"{name}: arrived in {sum(arrived[name])} of {len(scenes)} scenes")
        axes[0].legend(loc="lower left", frameon=True, facecolor=MUTED, labelcolor=PAPER)
        canvas.colorbar(axes[0].images[0], ax=axes, label="trust in a random move")
        canvas.savefig(folder / "trust.png", dpi=110)
    print(folder / "trust.png")
    return arrived


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "runs/own_world"))
