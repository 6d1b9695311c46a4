"""Checks that are not learned: accept everything, collisions by hand, the ensemble's own uncertainty."""

from __future__ import annotations

import math
from typing import final

import numpy as np
from jaxtyping import Float

from fairlead.core.errors import FairleadError
from fairlead.core.layout import StateLayout
from fairlead.core.records import Transitions
from fairlead.core.roles import Environment, TransitionCheck


@final
class AcceptAll(TransitionCheck):
    """Trusts every transition: the paper's planner without a classifier."""

    def encode(
        self, environment: Environment, states: Float[np.ndarray, "batch state"]
    ) -> Float[np.ndarray, "batch 0"]:
        return np.zeros((len(states), 0), np.float32)

    def probability(
        self,
        environment: Environment,
        transitions: Transitions,
        encodings: Float[np.ndarray, "batch 0"],
        next_encodings: Float[np.ndarray, "batch 0"],
    ) -> Float[np.ndarray, " batch"]:
        return np.ones(len(transitions))


@final
class CollisionCheck(TransitionCheck):
    """The hand-made baseline of the paper: no predicted object point inside the map inflated by the object's radius.

    Args:
        layout: how to read a state.
        radius: of the object [m].
    """

    def __init__(self, layout: StateLayout, radius: float) -> None:
        if not radius >= 0:
            raise FairleadError(f"radius {radius}: an object's radius is at least 0")
        self.layout, self.radius = layout, radius

    def encode(
        self, environment: Environment, states: Float[np.ndarray, "batch state"]
    ) -> Float[np.ndarray, "batch 1"]:
        """The least signed distance of the object points [m]."""
        distance = environment.distance_and_gradient(self.layout.object_of(states))[..., 0]
        return distance.min(axis=1, keepdims=True).astype(np.float32)

    def probability(
        self,
        environment: Environment,
        transitions: Transitions,
        encodings: Float[np.ndarray, "batch 1"],
        next_encodings: Float[np.ndarray, "batch 1"],
    ) -> Float[np.ndarray, " batch"]:
        return (next_encodings[:, 0] > self.radius).astype(float)


@final
class SpreadThreshold(TransitionCheck):
    """Trusts the ensemble's own uncertainty: p = threshold / (threshold + spread), above 0.5 below the threshold.

    Args:
        threshold: largest trusted spread [m], chosen on validation data.
    """

    def __init__(self, threshold: float) -> None:
        if not (threshold > 0 and math.isfinite(threshold)):
            raise FairleadError(f"spread threshold {threshold}: a positive number of metres is needed")
        self.threshold = threshold

    def encode(
        self, environment: Environment, states: Float[np.ndarray, "batch state"]
    ) -> Float[np.ndarray, "batch 0"]:
        return np.zeros((len(states), 0), np.float32)

    def probability(
        self,
        environment: Environment,
        transitions: Transitions,
        encodings: Float[np.ndarray, "batch 0"],
        next_encodings: Float[np.ndarray, "batch 0"],
    ) -> Float[np.ndarray, " batch"]:
        return self.threshold / (self.threshold + transitions.spread)
