"""Random scenes from a seed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fairlead.core.errors import FairleadError, SamplingError
from fairlead.core.streams import stream
from fairlead.scenarios import dragging_hard, dual_arm_hard
from fairlead.scenarios.dragging import Dragging
from fairlead.scenarios.dual_arm import DualArm
from fairlead.scenarios.scenario import Scenario
from fairlead.scenarios.scene_files import Scene

_TRIES = 100


def generate(
    scenario: Scenario, kind: str, count: int, seed: int, advance: Callable[[int], None] = lambda _: None
) -> list[Scene]:
    """`count` scenes, none with its goal reached at the start; scene i depends on the seed and i alone.

    Hard scenes take the hard kinds in turn.

    Raises:
        FairleadError: a count below 1, or hard scenes of a scenario that has none.
    """
    if count < 1:
        raise FairleadError(f"count {count}: at least 1 is needed")
    scenes = []
    for i in range(count):
        scene = _unsolved(scenario, kind, i, seed)
        scenario.validate(scene)
        scenes.append(scene)
        advance(1)
    return scenes


def _unsolved(scenario: Scenario, kind: str, i: int, seed: int) -> Scene:
    """Scene i, drawn again while its goal is reached at the start."""
    rng = stream(seed, "scene", kind, i)
    for _ in range(_TRIES):
        scene = _drawn(scenario, kind, i, seed, rng)
        if not scene.goal.reached(scene.state(scenario.layout)[None])[0]:
            return scene
    raise SamplingError(
        f"{kind} scene whose goal is not reached at the start", _TRIES, "draw goals from a larger region"
    )


def _drawn(scenario: Scenario, kind: str, i: int, seed: int, rng: np.random.Generator) -> Scene:
    if kind == "random":
        return scenario.random_scene(rng, f"random-{seed}-{i:03d}")
    for world, module in ((Dragging, dragging_hard), (DualArm, dual_arm_hard)):
        if isinstance(scenario, world):
            hard = tuple(module.KINDS)[i % len(module.KINDS)]
            return module.hard_scene(scenario, hard, rng, f"{hard}-{seed}-{i:03d}")
    raise FairleadError(f"scenario '{scenario.name}' has no hard scenes")
