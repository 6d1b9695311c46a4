"""`trust-sdf`: signed distances and their gradients at the points of both states, and a small network.

The paper shows its classifier the obstacles and the rope as voxels. What decides is how the points lie to the nearest
surfaces, and that can be looked up at the points themselves.
"""

from __future__ import annotations

from typing import final

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor, nn

from fairlead.core.layout import StateLayout
from fairlead.core.records import Transitions
from fairlead.core.roles import Environment
from fairlead.geometry.frames import heading, local_origin, turn_into
from fairlead.learning.labels import Examples
from fairlead.learning.trust_network import Inputs, TrustConfig, TrustNetwork

UNIT_M = 0.1
FAR_M = 0.25


@final
class SdfTrust(TrustNetwork):
    """Standardised features -> two hidden layers -> logit.

    An encoding holds distance [m] and gradient at each position of a state, in the world frame. Vectors are turned into
    the local frame; distances beyond `FAR_M` are all alike. Where the scenario is not planar, the place and the heading
    of that frame in the world are features too: arms do not reach everywhere.
    """

    mean: Tensor
    scale: Tensor

    def __init__(self, layout: StateLayout, config: TrustConfig) -> None:
        super().__init__()
        self.layout, self.config, self.planar = layout, config, config.planar
        positions, grippers = layout.state_size // 3, len(layout.grippers)
        axes = 2 if config.planar else 3
        self._vectors = (4 * positions + grippers) * axes
        size = self._vectors + 2 * positions + 1 + (0 if config.planar else 5)
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("scale", torch.ones(size))
        self.layers = nn.Sequential(
            nn.Linear(size, config.hidden),
            nn.ReLU(),
            nn.Linear(config.hidden, config.hidden),
            nn.ReLU(),
            nn.Linear(config.hidden, 1),
        )

    def forward(self, *inputs: Float[Tensor, "batch feature"]) -> Float[Tensor, " batch"]:
        return self.layers((inputs[0] - self.mean) / self.scale).squeeze(-1)

    def prepare(self, examples: Examples) -> Inputs:
        features = np.empty((len(examples), len(self.mean)), np.float32)
        for environment, rows in examples.by_scene():
            t = examples.take(rows).transitions
            features[rows] = self._features(
                t, self.encode(environment, t.states), self.encode(environment, t.next_states)
            )
        return lambda rows: (torch.from_numpy(features[rows]),)

    def standardise(self, inputs: Inputs, count: int) -> None:
        (features,) = inputs(np.arange(count))
        self.mean.copy_(features.mean(0))
        self.scale.copy_(features.std(0).clamp_min(1e-3))

    def augment(self, inputs: tuple[Tensor, ...], rng: np.random.Generator) -> tuple[Tensor, ...]:
        """In the plane, mirror half of the examples at the direction of the action."""
        if not (self.planar and self.config.augment):
            return inputs
        mirrored = inputs[0].clone()
        rows = torch.from_numpy(rng.random(len(mirrored)) < 0.5)
        mirrored[:, 1 : self._vectors : 2] = torch.where(rows[:, None], -1, 1) * mirrored[:, 1 : self._vectors : 2]
        return (mirrored,)

    def encode(
        self, environment: Environment, states: Float[np.ndarray, "batch state"]
    ) -> Float32[np.ndarray, "batch feature"]:
        found = environment.distance_and_gradient(states.reshape(len(states), -1, 3))
        return found.reshape(len(states), -1).astype(np.float32, copy=False)

    def frozen(
        self, environment: Environment, states: Float[np.ndarray, "batch state"]
    ) -> Float32[np.ndarray, "batch frozen"]:
        encoding = self.encode(environment, states)
        encoding[:, ::4] = np.clip(encoding[:, ::4], -FAR_M, FAR_M) / UNIT_M
        return encoding

    def judge(
        self,
        transitions: Transitions,
        encodings: Float32[np.ndarray, "batch feature"],
        next_encodings: Float32[np.ndarray, "batch feature"],
    ) -> Float[Tensor, " batch"]:
        return self(torch.from_numpy(self._features(transitions, encodings, next_encodings)))

    def _features(
        self,
        t: Transitions,
        encodings: Float32[np.ndarray, "batch feature"],
        next_encodings: Float32[np.ndarray, "batch feature"],
    ) -> Float32[np.ndarray, "batch feature"]:
        batch = len(t)
        origin = local_origin(self.layout, t.states)[:, None]
        before, after = (x.reshape(batch, -1, 3) for x in (t.states, t.next_states))
        asked = (t.actions - t.states[:, : self.layout.action_size]).reshape(batch, -1, 3)
        field = np.stack([encodings.reshape(batch, -1, 4), next_encodings.reshape(batch, -1, 4)], axis=1)
        slopes = field[..., 1:].reshape(batch, -1, 3)
        vectors = np.concatenate(
            [(before - origin) / UNIT_M, (after - before) / UNIT_M, asked / UNIT_M, slopes], axis=1, dtype=np.float32
        )
        along = heading(self.layout, t.states, t.actions)
        turned = [turn_into(along, vectors[..., :2])]
        if not self.planar:
            turned.append(vectors[..., 2:])
        distances = np.clip(field[..., 0], -FAR_M, FAR_M).reshape(batch, -1) / UNIT_M
        doubt = np.log(np.maximum(t.spread, 1e-6))[:, None]
        features = [np.concatenate(turned, axis=-1).reshape(batch, -1), distances, doubt]
        if not self.planar:
            features += [origin[:, 0], along]
        return np.concatenate(features, axis=1, dtype=np.float32)
