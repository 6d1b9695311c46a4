"""Laws of the full dynamics baseline."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from fairlead.core.contracts import check_dynamics
from fairlead.core.records import ActionOutcome
from fairlead.geometry.distance import model_error
from fairlead.geometry.fields import BoxEnvironment
from fairlead.geometry.shapes import Box
from fairlead.learning import full_dynamics
from fairlead.learning.fit import Stage
from fairlead.learning.full_dynamics import FullDynamicsConfig, LearnedFullDynamics, train_full_dynamics
from fairlead.learning.labels import CUT_BY_ARMS
from fairlead.learning.model_files import Job
from fairlead.learning.registry import load_full_dynamics
from fairlead.learning.rollout import dynamics_metrics, roll_out_all, rollout_errors
from fairlead.learning.trust_voxel import transformed
from fairlead.learning.voxels import Occupancy, VoxelGrid
from rope_data import LAYOUT, splits

DATA = splits(64, 6, 4)
CONFIG = FullDynamicsConfig(
    hidden=48, grid=VoxelGrid((22, 22, 1), 0.04), stages=(Stage(8, 32, 2e-3), Stage(1, 32, 3e-4, 2))
)


def test_full_dynamics_learn_see_obstacles_save_and_load(tmp_path: Path) -> None:
    dynamics = train_full_dynamics(DATA, CONFIG, Job(tmp_path, "toy"))
    predicted = roll_out_all(dynamics, DATA.validation, 3)
    actual = DATA.validation.states[:, 1:4]
    still = model_error(LAYOUT, DATA.validation.states[:, :1], actual)
    assert model_error(LAYOUT, predicted, actual).mean() < 0.8 * still.mean()

    states, actions = DATA.test.states[:6, 0], DATA.test.actions[:6, 0]
    free = DATA.test.environments[0]
    check_dynamics(dynamics, free, states, actions)
    here = dynamics.predict(free, states, actions)
    assert (here.spread == 0).all()
    loaded = load_full_dynamics(tmp_path, "toy").predict(free, states, actions)
    assert (loaded.mean == here.mean).all()

    known = DATA.train
    found = dynamics.predict_each(known.environments, known.scene, known.states[:, 0], known.actions[:, 0]).mean
    wanted = known.actions[:, 0] - known.states[:, 0, :3]
    done = ((found - known.states[:, 0])[:, :3] * wanted).sum(axis=1) / (wanted * wanted).sum(axis=1)
    refused = (known.states[:, 1] == known.states[:, 0]).all(axis=1)
    assert done[refused].mean() < 0.9 * done[~refused].mean()


def test_what_arms_cut_short_and_what_follows_is_not_judged() -> None:
    dynamics = LearnedFullDynamics(full_dynamics._build(LAYOUT, CONFIG, 0))
    outcomes = np.zeros_like(DATA.test.outcomes)
    outcomes[3, 2], outcomes[5, 0] = ActionOutcome.JOINT_LIMIT.number, ActionOutcome.ARM_COLLISION.number
    cut = replace(DATA.test, outcomes=outcomes)
    found = rollout_errors(dynamics, cut, CUT_BY_ARMS)
    assert np.argwhere(~found.counted).tolist() == [[3, t] for t in range(2, 6)] + [[5, t] for t in range(6)]
    assert rollout_errors(dynamics, cut).counted.all()
    metrics = dynamics_metrics(dynamics, replace(DATA, test=cut), CUT_BY_ARMS)
    assert metrics["test_point_error_m"] == pytest.approx(found.points[found.counted].mean())


def test_the_gradient_knows_that_the_origin_moves_along() -> None:
    """Where nothing is near, to move everything alike changes nothing of the predicted change."""
    module, empty = full_dynamics._build(LAYOUT, CONFIG, 0), BoxEnvironment([], DATA.test.environments[0].bounds)
    occupancy, states = Occupancy.of([empty], 0.04), torch.tensor(DATA.test.states[:4, 0]).float()
    actions = torch.tensor(DATA.test.actions[:4, 0]).float()
    shift = torch.zeros(4, 3, requires_grad=True)
    moved = states + shift.repeat(1, LAYOUT.state_size // 3)
    change = module(occupancy, np.zeros(4, int), moved, actions + shift) - moved
    (gradient,) = torch.autograd.grad(change.square().sum(), shift)
    np.testing.assert_allclose(gradient.numpy(), 0, atol=1e-5)


@pytest.mark.parametrize("symmetry", list(itertools.product([0, 1], repeat=3)))
def test_what_is_seen_in_a_symmetry_moves_as_in_the_moved_world(symmetry: tuple[int, int, int]) -> None:
    code, rng = np.array(symmetry), np.random.default_rng(0)
    config = replace(CONFIG, grid=VoxelGrid((23, 23, 1), 0.04))
    bounds = np.array([[-1.02, -1.02, 0.0], [1.02, 1.02, 0.04]])  # a cell's centre at the origin
    box = Box((0.2, 0.28, 0.2), (0.2, -0.12, 0.1))

    def moved(points: np.ndarray) -> np.ndarray:
        return transformed(torch.tensor(points).unflatten(-1, (-1, 3)), code).flatten(-2).numpy()

    turned = Box((0.28, 0.2, 0.2) if symmetry[2] else box.size, tuple(moved(np.array(box.position))))
    here, there = (Occupancy.of([BoxEnvironment([b], bounds)], 0.04) for b in (box, turned))
    states = np.tile(rng.uniform(-0.2, 0.2, (4, 3)), LAYOUT.state_size // 3) + rng.uniform(
        -0.1, 0.1, (4, LAYOUT.state_size)
    )
    actions = states[:, :3] + rng.uniform(-0.1, 0.1, (4, 3))
    module, scene = full_dynamics._build(LAYOUT, config, 0), np.zeros(4, int)
    s, a, moved_s, moved_a = (torch.tensor(x).float() for x in (states, actions, moved(states), moved(actions)))
    with torch.inference_mode():
        found = module(here, scene, s, a, code).numpy()
        expected = module(there, scene, moved_s, moved_a).numpy()
    np.testing.assert_allclose(moved(found), expected, atol=1e-5)


def test_rows_are_predicted_each_in_its_own_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(full_dynamics, "_ROWS", 3)
    module = full_dynamics._build(LAYOUT, CONFIG, 0)
    for parameter in module.parameters():
        parameter.data *= 2  # so that what an untrained network sees makes a difference
    dynamics = LearnedFullDynamics(module)
    data, scene = DATA.test, np.array([2, 0, 2, 1, 0, 3, 3])
    # Beside an obstacle, or all environments look alike.
    states = np.stack([np.tile([*_centre(data.environments[i]), 0.02], LAYOUT.state_size // 3) for i in scene])
    actions = states[:, :3] + 0.05
    together = dynamics.predict_each(data.environments, scene, states, actions).mean
    for n, index in enumerate(scene):
        alone = dynamics.predict(data.environments[index], states[n : n + 1], actions[n : n + 1]).mean
        np.testing.assert_allclose(together[n], alone[0], atol=1e-5)
    others = dynamics.predict_each(data.environments, (scene + 1) % 4, states, actions).mean
    assert (np.abs(others - together).max(axis=1) > 1e-4).all()


def _centre(environment: object) -> tuple[float, float]:
    box = environment.boxes[0]  # type: ignore[attr-defined]
    return box.position[0], box.position[1]
