"""The local frame that makes a learned model indifferent to where, and in the plane which way, things happen."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from fairlead.core.layout import StateLayout


def local_origin(layout: StateLayout, states: Float[np.ndarray, "*batch state"]) -> Float[np.ndarray, "*batch 3"]:
    """Origin of the local frame [m]: the gripper where there is one, else the mean of the object points.

    Paper, "Network architectures", "Dynamics model".
    """
    if len(layout.grippers) == 1:
        return layout.grippers_of(states)[..., 0, :]
    return layout.object_of(states).mean(axis=-2)


def heading(
    layout: StateLayout, states: Float[np.ndarray, "*batch state"], actions: Float[np.ndarray, "*batch action"]
) -> Float[np.ndarray, "*batch 2"]:
    """Unit vector in the horizontal plane that turns with the world: the local frame's first axis.

    One gripper: along the displacement that the action asks for. Several: from the first gripper to the last. (1, 0)
    where that has no horizontal part.
    """
    grippers = layout.grippers_of(states)
    along = grippers[..., -1, :] - grippers[..., 0, :] if len(layout.grippers) > 1 else actions - grippers[..., 0, :]
    flat = along[..., :2]
    length = np.linalg.norm(flat, axis=-1, keepdims=True)
    return np.where(length > 1e-9, flat / np.maximum(length, 1e-9), np.array([1.0, 0.0], dtype=flat.dtype))


def turn_into(
    direction: Float[np.ndarray, "*batch 2"], vectors: Float[np.ndarray, "*batch point 2"]
) -> Float[np.ndarray, "*batch point 2"]:
    """Components of horizontal vectors along `direction` and to its left: a rotation that carries it to (1, 0)."""
    c, s = direction[..., None, 0], direction[..., None, 1]
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([c * x + s * y, c * y - s * x], axis=-1)
