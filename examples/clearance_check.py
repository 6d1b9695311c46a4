"""A transition check of one's own: trust a prediction while the whole rope stays clear of every obstacle.

To use it by name (`fairlead evaluate ... --methods clearance`), a distribution declares it in its pyproject.toml:

    [project.entry-points."fairlead.checks"]
    clearance = "clearance_check:clearance"
"""

from __future__ import annotations

from typing import TYPE_CHECKING, final

import numpy as np

from fairlead.core.layout import StateLayout
from fairlead.core.records import Transitions
from fairlead.core.roles import Environment, TransitionCheck

if TYPE_CHECKING:
    from fairlead.evaluation.models import Models


@final
class Clearance(TransitionCheck):
    """Reliable where every point of the predicted rope is at least `margin` [m] from the nearest obstacle.

    What a check needs of a state alone is its encoding; a planner keeps it with the node. Here: the least distance.
    """

    def __init__(self, layout: StateLayout, margin: float) -> None:
        self.layout, self.margin = layout, margin

    def encode(self, environment: Environment, states: np.ndarray) -> np.ndarray:
        distance = environment.distance_and_gradient(self.layout.object_of(states))[..., 0]
        return distance.min(axis=1, keepdims=True).astype(np.float32)

    def probability(
        self, environment: Environment, transitions: Transitions, encodings: np.ndarray, next_encodings: np.ndarray
    ) -> np.ndarray:
        return (next_encodings[:, 0] >= self.margin).astype(float)


def clearance(models: Models) -> Clearance:
    """The check for the scenario whose models these are: one rope's radius between rope and obstacle."""
    return Clearance(models.scenario.layout, 2 * models.scenario.rope_radius)
