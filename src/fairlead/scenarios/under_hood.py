"""Three tasks under the hood of a car (paper, Fig. 2 D to F): move a hose, install a hose, remove lifting straps.

Two arms work over an engine bay of primitive shapes: an engine block with its pulley, an alternator, two tanks and a
battery, beside a raised hood and under a gantry. Each variation shifts and turns every part a little.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fairlead.core.errors import FairleadError, SamplingError
from fairlead.geometry.goals import OutsideGoal, PointsGoal, SceneGoal, point_goal
from fairlead.geometry.shapes import Box, Obstacle, box_distance, octagon
from fairlead.scenarios.arms import CLEARANCE
from fairlead.scenarios.dual_arm import LAYOUT, DualArm
from fairlead.scenarios.render import Colour
from fairlead.scenarios.task import TRIES, TaskSpec, clear

FLOOR = 0.625
"""Height of what the parts stand on [m]."""
ENGINE = (0.88, 0.0)
RADIUS = 0.05
"""How near an end or the midpoint must be to its place [m]."""


def _box(x: float, y: float, low: float, size: tuple[float, float, float]) -> Box:
    """An upright box whose lowest face lies `low` above the floor [m]."""
    return Box(size, (float(x), float(y), FLOOR + low + size[2] / 2))


def _drum(x: float, y: float, low: float, radius: float, length: float) -> tuple[Box, ...]:
    """An octagonal cylinder along y, as `octagon` makes it."""
    lying = Rotation.from_euler("x", 90, degrees=True)
    upright = octagon(radius, length)
    turned = ((lying * Rotation.from_quat(box.quaternion_xyzw)).as_quat() for box in upright)
    centre = (x, y, FLOOR + low + radius)
    return tuple(Box(box.size, centre, tuple(map(float, q))) for box, q in zip(upright, turned, strict=True))


def _hood() -> Box:
    """A panel that stands at the side, its upper edge leaning outwards by 15 degrees."""
    tilt = Rotation.from_euler("x", -15, degrees=True).as_quat()
    return Box((0.8, 0.02, 0.75), (0.82, 0.86, FLOOR + 0.36), tuple(map(float, tilt)))


PARTS: dict[str, tuple[Box, ...]] = {
    "engine": (_box(0, 0, 0, (0.26, 0.34, 0.14)), _box(0, 0, 0.14, (0.12, 0.30, 0.05))),
    "pulley": _drum(0.02, -0.19, 0.02, 0.065, 0.03),
    "alternator": _drum(0.19, 0.06, 0.01, 0.055, 0.12),
    "coolant": (_box(-0.20, -0.36, 0, (0.13, 0.13, 0.16)), _box(-0.20, -0.36, 0.16, (0.04, 0.04, 0.025))),
    "washer": (_box(0.08, 0.40, 0, (0.10, 0.18, 0.12)), _box(0.08, 0.45, 0.12, (0.035, 0.035, 0.05))),
    "battery": (_box(0.14, -0.43, 0, (0.17, 0.14, 0.15)),),
}
"""Each in the frame of the engine; all are shifted and turned, but for what carries nothing."""
FIXED = {
    "hood": (_hood(),),
    "gantry": (_box(1.16, 0.66, 0, (0.04, 0.04, 0.95)), _box(1.16, -0.66, 0, (0.04, 0.04, 0.95)),
               _box(1.16, 0, 0.95, (0.05, 1.36, 0.05))),
}  # fmt: skip
EYELETS = tuple(
    box for y in (0.10, -0.10)
    for box in (_box(0, y, 0.19, (0.03, 0.03, 0.09)), _box(-0.03, y, 0.28, (0.09, 0.06, 0.015)))
)  # fmt: skip
"""Two lifting eyelets on the engine, open to the front: a post with a plate on top."""
FITTINGS = tuple(
    box for y in (0.30, -0.30)
    for box in (_box(-0.10, y, 0, (0.025, 0.025, 0.24)), _box(-0.12, y, 0.24, (0.06, 0.03, 0.03)))
)  # fmt: skip
"""Two posts, each with a nipple towards the front that an end of the hose goes to."""
COLOURS: dict[str, Colour] = {
    "engine": (0.52, 0.55, 0.60, 1.0), "pulley": (0.16, 0.17, 0.19, 1.0), "alternator": (0.76, 0.74, 0.68, 1.0),
    "coolant": (0.93, 0.80, 0.78, 1.0), "washer": (0.60, 0.78, 0.93, 1.0), "battery": (0.22, 0.24, 0.30, 1.0),
    "hood": (0.55, 0.12, 0.14, 1.0), "gantry": (0.92, 0.70, 0.15, 1.0), "eyelets": (0.30, 0.32, 0.36, 1.0),
    "fittings": (0.15, 0.35, 0.65, 1.0),
}  # fmt: skip


def _bay(rng: np.random.Generator, **more: tuple[Box, ...]) -> tuple[Obstacle, ...]:
    """The engine bay with more parts on or at the engine. The engine moves with them; the rest also by itself."""
    shift, turn = rng.uniform(-0.03, 0.03, 2), float(rng.uniform(-0.1, 0.1))
    placed = []
    for name, boxes in (PARTS | more).items():
        loose = name not in ("engine", "eyelets")
        step, yaw = loose * rng.uniform(-0.015, 0.015, 2), loose * float(rng.uniform(-0.05, 0.05))
        centre = np.array([*boxes[0].position[:2], 0.0])
        part = Obstacle(name, boxes).moved(-centre, 0.0).moved(centre + np.append(step, 0.0), yaw)
        placed.append(part.moved((ENGINE[0] + shift[0], ENGINE[1] + shift[1], 0.0), turn))
    return (*placed, *(Obstacle(name, boxes) for name, boxes in FIXED.items()))


def _part(obstacles: Sequence[Obstacle], name: str) -> tuple[Box, ...]:
    return next(obstacle.boxes for obstacle in obstacles if obstacle.name == name)


def carried(
    world: DualArm, obstacles: Sequence[Sequence[Obstacle]], rngs: Sequence[np.random.Generator], threads: int
) -> Float[np.ndarray, "batch state"]:
    """Grasped above the bay, clear of it, and carried to a random pose in it."""
    starts = [_grasped(world, row, rng) for row, rng in zip(obstacles, rngs, strict=True)]
    return world.carried(obstacles, np.stack(starts), rngs, threads)


def _grasped(world: DualArm, obstacles: Sequence[Obstacle], rng: np.random.Generator) -> Float[np.ndarray, " state"]:
    for _ in range(TRIES):
        state = world.grasped(rng)
        if clear(world, obstacles, state):
            return state
    raise SamplingError("rope above the engine bay", TRIES, "grasp it higher")


def looped(
    world: DualArm, obstacles: Sequence[Sequence[Obstacle]], rngs: Sequence[np.random.Generator], threads: int
) -> Float[np.ndarray, "batch state"]:
    """The strap under the plates of both eyelets, against their posts, and pulled up a little.

    It hangs in front of the eyelets, its lowest point between engine and plates; then it is carried back, and up.
    """
    states, ways = [], []
    for row, rng in zip(obstacles, rngs, strict=True):
        posts = np.array([box.position for box in _part(row, "eyelets")[::2]])
        along = (posts[0] - posts[1])[:2] / np.linalg.norm((posts[0] - posts[1])[:2])
        front = np.array([-along[1], along[0], 0.0])
        front *= -np.sign(front[0])
        apart = rng.uniform(0.52, 0.62)
        ends = posts.mean(axis=0) + np.outer([0.5, -0.5], [*(apart * along), 0.0]) + 0.095 * front
        ends[:, 2] = 0.0
        ends[:, 2] = FLOOR + 0.19 + rng.uniform(0.022, 0.03) - world.rope.hanging(ends)[:, 2].min()
        states.append(LAYOUT.join(ends, world.rope.hanging(ends)))
        ways.append([-0.085 * front, np.array([0.0, 0.0, rng.uniform(0.0, 0.06)])])
    simulated, everyone = world.simulate(obstacles, np.stack(states), threads), np.arange(len(rngs))
    for leg in np.array(ways).transpose(1, 0, 2):
        targets = LAYOUT.grippers_of(simulated.observe()) + leg[:, None]
        simulated.carry(everyone, targets.reshape(len(rngs), -1))
    return simulated.observe()


def _caught(obstacles: Sequence[Obstacle], state: Float[np.ndarray, " state"]) -> bool:
    """Whether the strap runs under both plates."""
    points = LAYOUT.points_of(state)
    under = [box_distance([Box(p.size, (*p.position[:2], p.position[2] - 0.05), p.quaternion_xyzw)], points)
             for p in _part(obstacles, "eyelets")[1::2]]  # fmt: skip
    return all(distance.min() < 0.03 for distance in under)


def _looped_start(
    world: DualArm, obstacles: Sequence[Sequence[Obstacle]], rngs: Sequence[np.random.Generator], threads: int
) -> Float[np.ndarray, "batch state"]:
    """Looped, so that a pull upwards does not free the strap."""
    states = looped(world, obstacles, rngs, threads)
    pulled = world.simulate(obstacles, states, threads)
    for _ in range(2):
        pulled.execute(pulled.observe()[:, : LAYOUT.action_size] + np.tile([0.0, 0.0, 0.1], 2))
    if not all(_caught(row, state) for row, state in zip(obstacles, pulled.observe(), strict=True)):
        raise FairleadError("the eyelets do not hold the strap")
    return states


def _either(
    world: DualArm, obstacles: Sequence[Sequence[Obstacle]], rngs: Sequence[np.random.Generator], threads: int
) -> Float[np.ndarray, "batch state"]:
    """Half of the straps looped over the eyelets, half carried to random poses."""
    free, caught = carried(world, obstacles, rngs, threads), looped(world, obstacles, rngs, threads)
    return np.where(np.array([rng.random() < 0.5 for rng in rngs])[:, None], free, caught)


def _beside(world: DualArm, obstacles: tuple[Obstacle, ...], rng: np.random.Generator) -> SceneGoal:
    """The midpoint in the gap on either side of the engine, clear of everything."""
    boxes = [box for obstacle in obstacles for box in obstacle.boxes]
    engine = np.array(_part(obstacles, "engine")[0].position)
    for _ in range(TRIES):
        aside = rng.choice([-1.0, 1.0]) * rng.uniform(0.24, 0.30)
        place = engine + np.array([rng.uniform(-0.1, 0.12), aside, 0.0])
        place[2] = FLOOR + rng.uniform(0.08, 0.16)
        if box_distance(boxes, place) > 0.045:
            return point_goal(LAYOUT, "midpoint", place.round(4), RADIUS)
    raise SamplingError("place beside the engine", TRIES, "widen the gap")


def _ends(world: DualArm, obstacles: tuple[Obstacle, ...], rng: np.random.Generator) -> SceneGoal:
    """Each end before its nipple, where the arms can hold both."""
    boxes = [box for obstacle in obstacles for box in obstacle.boxes]
    nipples = _part(obstacles, "fittings")[1::2]
    places = np.array([box.position + (box.size[0] / 2 + 0.03) * -box.rotation[:, 0] for box in nipples]).round(4)
    arms = world.arms
    assert arms is not None
    joints, reached = arms.grasp(places[None])
    if not reached[0] or arms.clearance(joints, [boxes])[0] < CLEARANCE:
        raise FairleadError("the arms do not reach the fittings")
    left, right = (tuple(map(float, place)) for place in places)
    return PointsGoal(LAYOUT, (("tail", left), ("head", right)), RADIUS)


def _away(world: DualArm, obstacles: tuple[Obstacle, ...], rng: np.random.Generator) -> SceneGoal:
    """The whole strap outside a box around the engine and its eyelets."""
    engine = _part(obstacles, "engine")[0]
    position = (*engine.position[:2], FLOOR + 0.17)
    return OutsideGoal(LAYOUT, Box((0.36, 0.44, 0.34), position, engine.quaternion_xyzw))


VIEW = ((2.3, -0.75, 1.95), (0.68, 0.06, 0.93))
MOVE_HOSE = TaskSpec("move_hose", DualArm, _bay, carried, carried, _beside, COLOURS, VIEW)
INSTALL_HOSE = TaskSpec("install_hose", DualArm, partial(_bay, fittings=FITTINGS), carried, carried, _ends,
                        COLOURS, VIEW)  # fmt: skip
REMOVE_STRAPS = TaskSpec("remove_straps", DualArm, partial(_bay, eyelets=EYELETS), _looped_start, _either,
                         _away, COLOURS, VIEW)  # fmt: skip
