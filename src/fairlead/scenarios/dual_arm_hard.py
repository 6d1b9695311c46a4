"""Hard dual-arm scenes: ropes caught under a hook's plate, draped over obstacles, or led astray by random actions.

Every start comes from random actions, as in data collection; a kind is a test of where they left the rope. Whether a
scene can be solved is for trials to show, not for this file.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float

from fairlead.core.errors import SamplingError
from fairlead.core.records import ActionOutcome
from fairlead.geometry.shapes import Obstacle, box_distance
from fairlead.scenarios.dual_arm import LAYOUT, DualArm
from fairlead.scenarios.scene_files import Scene

ACTIONS, TOGETHER, ROUNDS = 15, 16, 40
"""Random actions before a start; candidates that are simulated together; how often, before giving up."""

Kind = Callable[[DualArm, Sequence[Obstacle], Float[np.ndarray, "point 3"]], bool]


def caught(scenario: DualArm, obstacles: Sequence[Obstacle], points: Float[np.ndarray, "point 3"]) -> bool:
    """The rope runs under the plate of a hook: pulled straight up, it would not come."""
    for post, plate in (obstacle.boxes for obstacle in obstacles if obstacle.name.startswith("hook")):
        low, high = post.position[2] - post.size[2] / 2, plate.position[2] - plate.size[2] / 2
        raised = np.concatenate([points[:, :2], np.full((len(points), 1), plate.position[2])], axis=1)
        if ((points[:, 2] > low) & (points[:, 2] < high) & (box_distance([plate], raised) < 0)).any():
            return True
    return False


def draped(scenario: DualArm, obstacles: Sequence[Obstacle], points: Float[np.ndarray, "point 3"]) -> bool:
    """The rope touches obstacles in at least two places, and not between them."""
    touching = _touching(scenario, obstacles, points)
    return int((np.diff(touching.astype(int)) == 1).sum() + touching[0]) >= 2


def astray(scenario: DualArm, obstacles: Sequence[Obstacle], points: Float[np.ndarray, "point 3"]) -> bool:
    """Wherever the actions led, in touch with something."""
    return bool(_touching(scenario, obstacles, points).any())


def _touching(
    scenario: DualArm, obstacles: Sequence[Obstacle], points: Float[np.ndarray, "point 3"]
) -> Bool[np.ndarray, " point"]:
    boxes = [box for obstacle in obstacles for box in obstacle.boxes]
    return np.asarray(box_distance(boxes, points) < scenario.rope_radius + 0.004)


KINDS: dict[str, Kind] = {"caught": caught, "draped": draped, "astray": astray}


def hard_scene(scenario: DualArm, kind: str, rng: np.random.Generator, name: str) -> Scene:
    """A scene whose start is of one of `KINDS`.

    Raises:
        SamplingError: random actions led to none.
    """
    for _ in range(ROUNDS):
        rngs = rng.spawn(TOGETHER)
        obstacles, states = scenario.rearrange(np.empty((TOGETHER, 0)), rngs)
        world = scenario.simulate(obstacles, states)
        displacement, keep = scenario.sampler.displacements(TOGETHER, rng), np.zeros(TOGETHER, bool)
        for _ in range(ACTIONS):
            displacement = scenario.sampler.redraw(displacement, keep, rng)
            executed = world.execute(scenario.sampler.targets(world.observe(), displacement))
            keep = executed.outcomes == ActionOutcome.TARGET.number
        for placed, state in zip(obstacles, world.observe(), strict=True):
            if KINDS[kind](scenario, placed, LAYOUT.points_of(state)):
                return scenario.scene(name, placed, state, rng)
    raise SamplingError(f"hard scene of kind '{kind}'", ROUNDS * TOGETHER, "loosen its test")
