"""The full dynamics baseline: one network that sees the obstacles and predicts what they do to the rope.

The image-conditioned network of Nagabandi et al. (IROS 2018) with voxels for images (paper, "Full dynamics"). The
voxels of the current state are drawn anew at every step of a rollout; no gradient passes through the drawing.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from fairlead.core.errors import FairleadError
from fairlead.core.layout import StateLayout
from fairlead.core.records import Prediction
from fairlead.core.roles import Dynamics, Environment
from fairlead.learning.device import beside, device_of, seeded
from fairlead.learning.fit import Stage, fit, stages_from
from fairlead.learning.labels import CUT_BY_ARMS
from fairlead.learning.model_files import Job, ModelFile, save_model
from fairlead.learning.networks import UNIT_M, local_origin
from fairlead.learning.rollout import Splits, dynamics_metrics
from fairlead.learning.rollout_task import RolloutTask
from fairlead.learning.trust_network import COARSE_GRID
from fairlead.learning.trust_voxel import VoxelEncoder, inverse, transformed, transformed_grid
from fairlead.learning.voxels import Occupancy, VoxelGrid

CODE = 5
UNMOVED = np.zeros(3, np.intp)
_ROWS = 128


@dataclass(frozen=True)
class FullDynamicsConfig:
    """How the baseline is built and trained.

    Args:
        hidden: units of each layer after the product (the paper: 200).
        planar: motion in a horizontal plane: layers of cells are convolved each by itself.
        grid: the voxels.
        augment: learn in the square's eight symmetries, as the classifier does.
        stages: as for the unconstrained dynamics.
        patience: epochs without improvement after which a stage ends.
    """

    hidden: int = 200
    planar: bool = True
    grid: VoxelGrid = COARSE_GRID
    augment: bool = True
    stages: tuple[Stage, ...] = (Stage(12, 64, 1e-3, 1), Stage(3, 32, 3e-4, 4))
    patience: int = 10

    def __post_init__(self) -> None:
        if min(self.hidden, len(self.stages)) < 1:
            raise FairleadError("full dynamics: hidden and the number of stages must be positive")


@final
class FullNetwork(nn.Module):
    """Voxels -> encoder -> 32 -> 32 -> 5; state and action -> hidden; outer product -> hidden -> hidden -> change."""

    def __init__(self, layout: StateLayout, config: FullDynamicsConfig) -> None:
        super().__init__()
        self.layout, self.grid, self.planar, hidden = layout, config.grid, config.planar, config.hidden
        self.encoder = VoxelEncoder(config.grid.channels(layout), config.grid, config.planar)
        sizes = (self.encoder.size, 32, 32)
        self.code = nn.Sequential(
            *(layer for i in range(2) for layer in (nn.Linear(sizes[i], sizes[i + 1]), nn.ReLU())), nn.Linear(32, CODE)
        )
        self.vectors = nn.Sequential(nn.Linear(layout.state_size + layout.action_size, hidden), nn.ReLU())
        self.change = nn.Sequential(
            nn.Linear(hidden * CODE, hidden),
            nn.ReLU(),
            nn.Linear(hidden, hidden),
            nn.ReLU(),
            nn.Linear(hidden, layout.state_size),
        )

    def forward(
        self,
        occupancy: Occupancy,
        scene: Int[np.ndarray, " batch"],
        states: Float[Tensor, "batch state"],
        actions: Float[Tensor, "batch action"],
        symmetry: Int[np.ndarray, " 3"] = UNMOVED,
    ) -> Float[Tensor, "batch state"]:
        """The next states [m], as predicted where everything is seen in that symmetry (see `transformed`)."""
        voxels = self.grid.draw(self.layout, occupancy, scene, states.detach().cpu().numpy())
        code = self.code(self.encoder(transformed_grid(voxels, symmetry)))
        positions = states.unflatten(-1, (-1, 3))
        points = torch.cat([positions, actions.unflatten(-1, (-1, 3))], dim=1)
        local = ((points - local_origin(self.layout, positions)) / UNIT_M).flatten(1)
        product = self.vectors(_moved(local, symmetry))[:, :, None] * code[:, None, :]
        change = UNIT_M * self.change(product.flatten(1))
        if self.planar:  # heights are left alone, as the unconstrained dynamics do
            change = change * change.new_tensor([1.0, 1.0, 0.0]).repeat(self.layout.state_size // 3)
        return states + _moved(change, inverse(symmetry))


def _moved(vectors: Float[Tensor, "batch vector"], symmetry: Int[np.ndarray, " 3"]) -> Float[Tensor, "batch vector"]:
    return transformed(vectors.unflatten(-1, (-1, 3)), symmetry).flatten(-2)


@final
class LearnedFullDynamics(Dynamics):
    """The trained baseline. A single network has no spread: it is zero."""

    def __init__(self, module: FullNetwork) -> None:
        self._module = module

    @property
    def layout(self) -> StateLayout:
        return self._module.layout

    def predict(
        self,
        environment: Environment,
        states: Float[np.ndarray, "batch state"],
        actions: Float[np.ndarray, "batch action"],
    ) -> Prediction:
        return self.predict_each([environment], np.zeros(len(states), np.intp), states, actions)

    def predict_each(
        self,
        environments: Sequence[Environment],
        scene: Int[np.ndarray, " batch"],
        states: Float[np.ndarray, "batch state"],
        actions: Float[np.ndarray, "batch action"],
    ) -> Prediction:
        used, row = np.unique(scene, return_inverse=True)
        there = [environments[index] for index in used]
        occupancy = Occupancy.of(there, self._module.grid.resolution, device_of(self._module))
        mean = np.empty(states.shape, np.float32)
        for low in range(0, len(states), _ROWS):
            rows = slice(low, low + _ROWS)
            with torch.inference_mode():
                s, a = (beside(self._module, np.asarray(x[rows], np.float32)) for x in (states, actions))
                mean[rows] = self._module(occupancy, row[rows], s, a).cpu().numpy()
        return Prediction(mean, np.zeros(len(mean), np.float32))


def _build(layout: StateLayout, config: FullDynamicsConfig, seed: int) -> FullNetwork:
    return seeded(lambda: FullNetwork(layout, config), seed, "full-dynamics")


def train_full_dynamics(data: Splits, config: FullDynamicsConfig, job: Job) -> LearnedFullDynamics:
    """Train the baseline on data among obstacles (as much as both phases have together) and save it.

    As for the classifier, what an arm cut short is not learned from, nor judged by: no network here sees the arms.
    """
    started = time.monotonic()
    module = _build(data.layout, config, job.seed).to(job.device)
    occupancy = Occupancy.of(data.train.environments, config.grid.resolution, job.device)
    square = config.grid.shape[0] == config.grid.shape[1]

    def step(states: Tensor, actions: Tensor, scene: Tensor, rng: np.random.Generator) -> Tensor:
        symmetry = rng.integers(0, 2, 3) * (1, 1, square) if config.augment else UNMOVED
        return module(occupancy, scene[0].numpy(), states[0], actions[0], symmetry)[None]

    dynamics = LearnedFullDynamics(module)
    key = job.key("full-dynamics", config)
    task = RolloutTask(module, step, dynamics, data, leave_out=CUT_BY_ARMS)
    earlier_s = fit(task, config.stages, job.seed, job.folder, key=key, patience=config.patience, title="full dynamics")
    metrics = dynamics_metrics(dynamics, data, CUT_BY_ARMS)
    seconds = earlier_s + time.monotonic() - started
    save_model(job, "full-dynamics", "voxel", data.layout, config, module.state_dict(), metrics, seconds)
    return dynamics


def full_dynamics_from(model: ModelFile) -> LearnedFullDynamics:
    """The baseline of a model that was read."""
    values: dict[str, Any] = model.config
    stages, grid = stages_from(values["stages"]), VoxelGrid.read(values["grid"])
    module = _build(model.layout, FullDynamicsConfig(**{**values, "stages": stages, "grid": grid}), 0)
    model.load_into(module)
    return LearnedFullDynamics(module)
