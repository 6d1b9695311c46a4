"""The distance d between states, and the error of a prediction per point."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from fairlead.core.layout import StateLayout


def model_error(
    layout: StateLayout, predicted: Float[np.ndarray, "*#batch state"], actual: Float[np.ndarray, "*#batch state"]
) -> Float[np.ndarray, "*#batch"]:
    """d(s_hat, s) of Eq. 1 [m]: the L2 norm over the whole concatenated object, grippers left out if there is one."""
    difference = layout.object_of(predicted - actual)
    return np.asarray(np.linalg.norm(difference.reshape(*difference.shape[:-2], -1), axis=-1))


def point_error(
    layout: StateLayout, predicted: Float[np.ndarray, "*#batch state"], actual: Float[np.ndarray, "*#batch state"]
) -> Float[np.ndarray, "*#batch"]:
    """Euclidean distance per object point [m], averaged over the points: the paper's learning error."""
    return np.asarray(np.linalg.norm(layout.object_of(predicted - actual), axis=-1).mean(axis=-1))
