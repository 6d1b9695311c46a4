"""Prints the rates behind each ratio, and the ratios as one JSON object on the last line."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from benchmarks.collection import collect_vs_raw
from benchmarks.planning import planner_vs_networks, planner_vs_ompl, rate_by_tree_size
from benchmarks.rates import Rates
from fairlead.core.roles import Dynamics, TransitionCheck
from fairlead.core.streams import stream
from fairlead.data.collect import GROUP
from fairlead.learning.dynamics import Ensemble, LearnedDynamics
from fairlead.learning.registry import load_check, load_dynamics, use_threads
from fairlead.learning.trust import LearnedCheck, build_network
from fairlead.planning.problem import Problem
from fairlead.reproduce.presets import preset
from fairlead.scenarios.arms_check import within_reach
from fairlead.scenarios.registry import scenario as find_scenario
from fairlead.scenarios.scenario import Scenario


@dataclass(frozen=True)
class Bench:
    """Measure collection and planning. Anything else that runs on the machine shows in the numbers."""

    scenarios: tuple[str, ...] = ("dragging", "dual_arm")
    """The worlds."""
    models: Path | None = None
    """Folder of trained models of one scenario (dynamics, trust-sdf); untrained networks by default."""
    lanes: int = GROUP
    """Simulations side by side, of one process: collection has as many processes as there are threads and lanes for."""
    steps: int = 30
    """Actions in a trajectory."""

    def run(self) -> None:
        """Measure, and print."""
        use_threads(1)
        ratios: dict[str, float] = {}
        for name in self.scenarios:
            for what, rates in self._measure(find_scenario(name)).items():
                print(f"{name}_{what}: {rates.ours:,.0f} against {rates.reference:,.0f} a second", file=sys.stderr)
                ratios[f"{name}_{what}"] = round(rates.ratio, 3)
        print(json.dumps(ratios))

    def _measure(self, world: Scenario) -> dict[str, Rates]:
        scene = world.random_scene(stream(0, "bench"), "bench")
        dynamics, check = self._networks(world)
        problem = Problem(world.environment(scene.obstacles), scene.goal, dynamics, check, world.sampler)
        start = scene.state(world.layout)
        for nodes, rate in rate_by_tree_size(problem, start).items():
            print(f"planner with {nodes:,} nodes: {rate:,.0f} checked transitions a second", file=sys.stderr)
        return {
            "collect_vs_raw": collect_vs_raw(world, self.lanes, self.steps, threads=1),
            "planner_vs_ompl": planner_vs_ompl(problem, start),
            "planner_vs_networks": planner_vs_networks(problem, start),
        }

    def _networks(self, world: Scenario) -> tuple[Dynamics, TransitionCheck]:
        """The dynamics, and the check that planning asks: the classifier and, where there are any, the arms."""
        if self.models is None:
            sizes = preset(world, "desk")
            dynamics = LearnedDynamics(Ensemble(world.layout, sizes.dynamics, seed=0))
            check = LearnedCheck(build_network(world.layout, sizes.trust_sdf, seed=0))
        else:
            dynamics = load_dynamics(self.models / "dynamics", world.name)
            check = load_check(self.models / "trust-sdf", world.name)
        return dynamics, within_reach(check, world)


if __name__ == "__main__":
    tyro.cli(Bench).run()
