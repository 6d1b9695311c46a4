"""The distance d between states, and the error of a prediction per point."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from fairlead.core.layout import StateLayout


def model_error(
    layout: StateLayout, predicted: Float[np.ndarray, "*#batch state"], actual: Float[np.ndarray, "*#batch state"]
) -> Float[np.ndarray, "*#batch"]:
    """d(s_hat, s) of Eq. 1 [m]: the L2 norm over the whole concatenated rope, grippers left out."""
    return np.asarray(np.linalg.norm(predicted[..., layout.action_size :] - actual[..., layout.action_size :], axis=-1))


def point_error(
    layout: StateLayout, predicted: Float[np.ndarray, "*#batch state"], actual: Float[np.ndarray, "*#batch state"]
) -> Float[np.ndarray, "*#batch"]:
    """Euclidean distance per rope point [m], averaged over the points: the paper's learning error."""
    return np.asarray(np.linalg.norm(layout.points_of(predicted) - layout.points_of(actual), axis=-1).mean(axis=-1))
