"""Random scenes from a seed."""

from __future__ import annotations

from collections.abc import Callable

from fairlead.core.errors import FairleadError
from fairlead.core.streams import stream
from fairlead.scenarios.dragging import Dragging
from fairlead.scenarios.dragging_hard import KINDS, hard_scene
from fairlead.scenarios.scenario import Scenario
from fairlead.scenarios.scene_files import Scene


def generate(
    scenario: Scenario, kind: str, count: int, seed: int, advance: Callable[[int], None] = lambda _: None
) -> list[Scene]:
    """`count` scenes; scene i depends on the seed and i alone. Hard scenes take the hard kinds in turn.

    Raises:
        FairleadError: a count below 1, or hard scenes of a scenario that has none.
    """
    if count < 1:
        raise FairleadError(f"count {count}: at least 1 is needed")
    scenes = []
    for i in range(count):
        rng = stream(seed, "scene", kind, i)
        if kind == "random":
            scene = scenario.random_scene(rng, f"random-{seed}-{i:03d}")
        elif isinstance(scenario, Dragging):
            hard = tuple(KINDS)[i % len(KINDS)]
            scene = hard_scene(scenario, hard, rng, f"{hard}-{seed}-{i:03d}")
        else:
            raise FairleadError(f"scenario '{scenario.name}' has no hard scenes")
        scenario.validate(scene)
        scenes.append(scene)
        advance(1)
    return scenes
