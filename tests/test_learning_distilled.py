"""Laws of the network that is distilled from an ensemble."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from fairlead.core.errors import ArtifactError, FairleadError
from fairlead.core.records import Prediction
from fairlead.geometry.distance import point_error
from fairlead.geometry.fields import BoxEnvironment
from fairlead.geometry.motion import RandomDisplacement
from fairlead.learning.distilled import Distilled, DistilledConfig, train_distilled
from fairlead.learning.dynamics import DynamicsConfig, Ensemble, LearnedDynamics
from fairlead.learning.fit import Stage
from fairlead.learning.model_files import Job
from fairlead.learning.registry import load_distilled
from rope_data import BOUNDS, LAYOUT, splits, straight_ropes

FREE = BoxEnvironment([], BOUNDS)
SAMPLER = RandomDisplacement(LAYOUT, 0.15, (-np.inf,) * 3, (np.inf,) * 3, planar=True)
CONFIG = DistilledConfig(samples=2048, hidden=16, stages=(Stage(6, 64, 2e-3),))
DATA = splits(16, 6, 0)


def ensemble(planar: bool = True) -> LearnedDynamics[Ensemble]:
    """Members that disagree."""
    module = Ensemble(LAYOUT, DynamicsConfig(hidden=16, blocks=1, members=3, planar=planar), 1).eval()
    generator = torch.Generator().manual_seed(0)
    with torch.no_grad():
        for parameter in module.parameters():
            parameter.add_(0.1 * torch.randn(parameter.shape, generator=generator))
    return LearnedDynamics(module)


def transitions(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    states = straight_ropes(count, rng)
    return states, SAMPLER.propose(states, rng)


def differences(ours: Prediction, theirs: Prediction) -> tuple[float, float]:
    """Of the mean, per point [m], and of the logarithm of the spread."""
    doubt = np.abs(np.log(ours.spread) - np.log(theirs.spread)).mean()
    return float(point_error(LAYOUT, ours.mean, theirs.mean).mean()), float(doubt)


@pytest.mark.parametrize("planar", [True, False])
def test_it_begins_as_the_ensembles_first_member(planar: bool) -> None:
    teacher, (states, actions) = ensemble(planar), transitions(5, 0)
    module = Distilled(LAYOUT, teacher.module.config, CONFIG, 0)
    module.begin_with(teacher.module)
    tensors = (torch.tensor(x).float() for x in (states, actions))
    first = teacher.module(*(x.expand(3, -1, -1) for x in tensors))[0].detach().numpy()
    np.testing.assert_allclose(LearnedDynamics(module).predict(FREE, states, actions).mean, first, atol=1e-6)


def test_it_comes_nearer_to_the_ensemble_than_a_member_is_and_is_the_same_from_disk(tmp_path: Path) -> None:
    teacher, (states, actions) = ensemble(), transitions(200, 1)
    member = Distilled(LAYOUT, teacher.module.config, CONFIG, 0)
    member.begin_with(teacher.module)
    trained = train_distilled(teacher, DATA, SAMPLER, CONFIG, Job(tmp_path / "distilled", "dragging"))
    there = teacher.predict(FREE, states, actions)
    before = differences(LearnedDynamics(member).predict(FREE, states, actions), there)
    after = differences(trained.predict(FREE, states, actions), there)
    assert after[0] < 0.5 * before[0]
    assert after[1] < 0.5 * before[1]
    read = load_distilled(tmp_path / "distilled", "dragging").predict(FREE, states, actions)
    np.testing.assert_array_equal(read.mean, trained.predict(FREE, states, actions).mean)
    np.testing.assert_array_equal(read.spread, trained.predict(FREE, states, actions).spread)
    with pytest.raises(ArtifactError, match="one of 'dual_arm' is needed"):
        load_distilled(tmp_path / "distilled", "dual_arm")


def test_rows_are_independent_and_the_spread_is_positive() -> None:
    dynamics = LearnedDynamics(Distilled(LAYOUT, ensemble().module.config, CONFIG, 0).eval())
    states, actions = transitions(7, 2)
    whole, alone = (dynamics.predict(FREE, states[s], actions[s]) for s in (slice(None), slice(3, 4)))
    np.testing.assert_allclose(alone.mean[0], whole.mean[3], atol=1e-6)
    np.testing.assert_allclose(alone.spread[0], whole.spread[3], rtol=1e-5)
    assert (whole.spread > 0).all()


@pytest.mark.parametrize("wrong", [{"samples": 7}, {"hidden": 0}, {"stages": ()}])
def test_settings_that_mean_nothing_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(FairleadError, match="distilled"):
        DistilledConfig(**wrong)  # pyright: ignore[reportArgumentType]
