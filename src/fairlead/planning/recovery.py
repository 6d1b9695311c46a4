"""Recovery policies that are not learned."""

from __future__ import annotations

from typing import final

import numpy as np
from jaxtyping import Float

from fairlead.core.roles import ActionSampler, Environment, RecoveryPolicy


@final
class NoRecovery(RecoveryPolicy):
    """Always declines."""

    def choose(
        self, environment: Environment, states: Float[np.ndarray, "batch state"], rng: np.random.Generator
    ) -> Float[np.ndarray, "batch action"] | None:
        return None


@final
class RandomRecovery(RecoveryPolicy):
    """A random action of `sampler`: the paper's baseline for recovery."""

    def __init__(self, sampler: ActionSampler) -> None:
        self.sampler = sampler

    def choose(
        self, environment: Environment, states: Float[np.ndarray, "batch state"], rng: np.random.Generator
    ) -> Float[np.ndarray, "batch action"] | None:
        return self.sampler.propose(states, rng)
