"""Prints the rates behind each ratio, and the ratios as one JSON object on the last line."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from benchmarks.collection import collect_vs_raw
from benchmarks.planning import planner_vs_networks, planner_vs_ompl, rate_by_tree_size
from fairlead.core.roles import Dynamics, TransitionCheck
from fairlead.core.streams import stream
from fairlead.learning.dynamics import DynamicsConfig, Ensemble, LearnedDynamics
from fairlead.learning.registry import load_check, load_dynamics, use_threads
from fairlead.learning.trust import LearnedCheck, build_network
from fairlead.learning.trust_network import TrustConfig
from fairlead.planning.problem import Problem
from fairlead.scenarios.registry import scenario as find_scenario
from fairlead.scenarios.scenario import Scenario


@dataclass(frozen=True)
class Bench:
    """Measure collection and planning. Anything else that runs on the machine shows in the numbers."""

    scenario: str = "dragging"
    """The world."""
    models: Path | None = None
    """Folder of trained models (dynamics, trust-sdf); networks of the same sizes, untrained, by default."""
    lanes: int = 64
    """Simulations side by side."""
    steps: int = 20
    """Actions in a trajectory."""
    threads: int = os.cpu_count() or 1
    """Of the simulator. Planning runs on one."""

    def run(self) -> None:
        """Measure, and print."""
        world = find_scenario(self.scenario)
        use_threads(1)
        scene = world.random_scene(stream(0, "bench"), "bench")
        dynamics, check = self._networks(world)
        problem = Problem(world.environment(scene.obstacles), world.goal(scene), dynamics, check, world.sampler)
        start = scene.state(world.layout)
        measured = {
            "collect_vs_raw": collect_vs_raw(world, self.lanes, self.steps, self.threads),
            "planner_vs_ompl": planner_vs_ompl(problem, start),
            "planner_vs_networks": planner_vs_networks(problem, start),
        }
        for name, rates in measured.items():
            print(f"{name}: {rates.ours:,.0f} against {rates.reference:,.0f} a second", file=sys.stderr)
        for nodes, rate in rate_by_tree_size(problem, start).items():
            print(f"planner with {nodes:,} nodes: {rate:,.0f} checked transitions a second", file=sys.stderr)
        print(json.dumps({f"{self.scenario}_{name}": round(rates.ratio, 3) for name, rates in measured.items()}))

    def _networks(self, world: Scenario) -> tuple[Dynamics, TransitionCheck]:
        if self.models is None:
            dynamics = LearnedDynamics(Ensemble(world.layout, DynamicsConfig(), seed=0))
            return dynamics, LearnedCheck(build_network(world.layout, TrustConfig(), seed=0))
        return load_dynamics(self.models / "dynamics", world.name), load_check(self.models / "trust-sdf", world.name)


if __name__ == "__main__":
    tyro.cli(Bench).run()
