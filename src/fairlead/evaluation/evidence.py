"""Single examples worth looking at: a labelled trajectory (Fig. 3), voxels (Fig. 5), accepted contacts (Fig. S1).

A folder of evidence holds `trajectory.npz`, `voxels.npz` and `contacts.npz`, where data for them were found, and a
manifest. Obstacles are rows of 10 numbers: size, position, quaternion (x, y, z, w); rows of zeros fill up.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from fairlead.core.artifacts import Manifest, sha256, write_atomic
from fairlead.core.records import Trajectories
from fairlead.core.roles import Dynamics, Environment, TransitionCheck
from fairlead.core.streams import stream
from fairlead.geometry.distance import model_error
from fairlead.geometry.fields import BoxEnvironment
from fairlead.learning.labels import Examples, label
from fairlead.learning.rollout import roll_out
from fairlead.learning.voxels import Occupancy, VoxelGrid

Arrays = dict[str, np.ndarray]
_WANTED = np.array([1, 1, 1, 1, 0, -1])
"""The labels that explain Fig. 3 best: reliable, then not, then discarded."""
_CANDIDATES, _EXAMPLES, _CONTACTS = 2000, 4000, 12


def box_rows(environment: Environment) -> Float[np.ndarray, "box 10"]:
    """The obstacles of an environment made of boxes; none for a sensed map."""
    boxes = environment.boxes if isinstance(environment, BoxEnvironment) else ()
    return np.array([[*box.size, *box.position, *box.quaternion_xyzw] for box in boxes]).reshape(-1, 10)


def labelled_trajectory(dynamics: Dynamics, data: Trajectories, delta: float, rng: np.random.Generator) -> Arrays:
    """The rollout, of many random ones, whose labels are most like those that Fig. 3 explains.

    actual, predicted: (7, point, 3) [m]; distance d: (7,) [m]; labels: (6,), 1, 0, or -1 for discarded.
    """
    steps = min(len(_WANTED), data.actions.shape[1])
    scenes = rng.permutation(np.unique(data.scene))[:40]
    best: tuple[int, Arrays] = (-1, {})
    for scene in map(int, scenes):
        rows = rng.choice(np.flatnonzero(data.scene == scene), _CANDIDATES // len(scenes))
        first = rng.integers(data.actions.shape[1] - steps + 1, size=len(rows))
        at = first[:, None] + np.arange(steps + 1)
        actual = data.states[rows[:, None], at]
        actions = data.actions[rows[:, None], at[:, :-1]]
        predicted, _ = roll_out(dynamics, data.environments, data.scene[rows], actual[:, 0], actions)
        distance = model_error(data.layout, predicted, actual)
        close = distance < delta
        labels = np.where(close[:, :-1], close[:, 1:].astype(int), -1)
        score = (labels == _WANTED[:steps]).sum(axis=1)
        row = int(score.argmax())
        if score[row] > best[0]:
            found = {
                "actual": data.layout.object_of(actual[row]),
                "predicted": data.layout.object_of(predicted[row]),
                "distance": distance[row],
                "labels": labels[row],
                "delta": np.array(delta),
                "boxes": box_rows(data.environments[scene]),
            }
            best = int(score[row]), found
    return best[1]


def voxels(data: Trajectories, grid: VoxelGrid, rng: np.random.Generator) -> Arrays:
    """The local voxel grid of the state, of many random ones, that sees most of the obstacles."""
    rows = rng.integers(len(data), size=60)
    best: tuple[float, np.ndarray] = (-1.0, np.zeros(0))
    for row in rows:
        occupancy = Occupancy.of([data.environments[int(data.scene[row])]], grid.resolution)
        drawn = grid.draw(data.layout, occupancy, np.zeros(1, int), data.states[row, -1:].astype(float))[0].numpy()
        if drawn[0].mean() > best[0]:
            best = float(drawn[0].mean()), drawn
    names = np.array(["obstacles", "rope", *data.layout.grippers])
    return {"channels": best[1], "resolution": np.array(grid.resolution), "names": names}


def accepted_contacts(check: TransitionCheck, examples: Examples, data: Trajectories, contact_m: float) -> Arrays:
    """Reliable transitions that end in contact and that the check accepts, the longest motions first, one a scene.

    A rope point within `contact_m` [m] of an obstacle is in contact. Empty where there are none.
    """
    chosen: list[Arrays] = []
    for environment, rows in examples.by_scene():
        part = examples.take(rows).transitions
        encodings = check.encode(environment, part.states), check.encode(environment, part.next_states)
        trust = check.probability(environment, part, *encodings)
        trajectory, step = examples.source[rows, 0], examples.source[rows, 2]
        before, after = (data.layout.object_of(data.states[trajectory, step + i]) for i in (0, 1))
        touching = environment.signed_distance(after).min(axis=1) < contact_m
        moved = np.linalg.norm(after - before, axis=-1).mean(axis=-1)
        moved[~(touching & (trust > 0.5) & examples.labels[rows])] = 0.0
        row = int(moved.argmax())
        if moved[row] > 0.02:
            predicted = data.layout.object_of(part.next_states[row])
            found = {"before": before[row], "after": after[row], "predicted": predicted, "probability": trust[row]}
            chosen.append({**found, "boxes": box_rows(environment), "moved": moved[row]})
    chosen.sort(key=lambda item: -float(item.pop("moved")))
    return _stack(chosen[:_CONTACTS])


def _stack(items: Sequence[Arrays]) -> Arrays:
    if not items:
        return {}
    most = max(len(item["boxes"]) for item in items)
    for item in items:
        item["boxes"] = np.pad(item["boxes"], ((0, most - len(item["boxes"])), (0, 0)))
    return {key: np.stack([item[key] for item in items]) for key in items[0]}


def write_evidence(
    dynamics: Dynamics,
    check: TransitionCheck,
    data: Trajectories,
    delta: float,
    grid: VoxelGrid,
    contact_m: float,
    folder: Path,
    seed: int,
    inputs: Mapping[str, str],
) -> None:
    """Write a folder of evidence.

    Args:
        dynamics: the unconstrained dynamics.
        check: the classifier whose accepted contacts are shown.
        data: held-out trajectories among obstacles.
        delta: the distance within which a prediction is reliable [m].
        grid: the voxels to draw.
        contact_m: how near to an obstacle a rope point is in contact [m], the rope's radius and a little more.
        folder: where to write.
        seed: of the choices.
        inputs: hashes of the manifests of models and data.
    """
    examples = label(dynamics, data, delta).sample(_EXAMPLES, stream(seed, "evidence", "examples"))
    found = {
        "trajectory": labelled_trajectory(dynamics, data, delta, stream(seed, "evidence", "trajectory")),
        "voxels": voxels(data, grid, stream(seed, "evidence", "voxels")),
        "contacts": accepted_contacts(check, examples, data, contact_m),
    }
    files = {}
    for name, arrays in found.items():
        if arrays:
            buffer = io.BytesIO()
            np.savez_compressed(buffer, allow_pickle=False, **arrays)
            write_atomic(folder / f"{name}.npz", buffer.getvalue())
            files[f"{name}.npz"] = sha256(folder / f"{name}.npz")
    config = {"delta_m": delta, "contact_m": contact_m}
    Manifest("evidence", config, seed, files, dict(inputs), {}).write(folder)
