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
    """`count` valid scenes, none with its goal reached at the start; scene i depends on the seed and i alone.

    Hard scenes take the hard kinds in turn.

    Raises:
        FairleadError: a count below 1, or hard scenes of a scenario that has none.
    """
    if count < 1:
        raise FairleadError(f"count {count}: at least 1 is needed")
    scenes = []
    for i in range(count):
        scenes.append(_valid(scenario, kind, i, seed))
        advance(1)
    return scenes


def _valid(scenario: Scenario, kind: str, i: int, seed: int) -> Scene:
    """Scene i, drawn again while its goal is reached at the start or, say, the arms do not reach it any more."""
    rng, problem = stream(seed, "scene", kind, i), "its goal is reached at the start"
    for _ in range(_TRIES):
        scene = _drawn(scenario, kind, i, seed, rng)
        if scene.goal.reached(scene.state(scenario.layout)[None])[0]:
            continue
        try:
            scenario.validate(scene)
        except FairleadError as error:
            problem = str(error)
        else:
            return scene
    raise SamplingError(f"valid {kind} scene", _TRIES, f"look at what was wrong with the last: {problem}")


def _drawn(scenario: Scenario, kind: str, i: int, seed: int, rng: np.random.Generator) -> Scene:
    if kind == "random":
        return scenario.random_scene(rng, f"random-{seed}-{i:03d}")
    for world, module in ((Dragging, dragging_hard), (DualArm, dual_arm_hard)):
        if isinstance(scenario, world):
            hard = tuple(module.KINDS)[i % len(module.KINDS)]
            return module.hard_scene(scenario, hard, rng, f"{hard}-{seed}-{i:03d}")
    raise FairleadError(f"scenario '{scenario.name}' has no hard scenes")
