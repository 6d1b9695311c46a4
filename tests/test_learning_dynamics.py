"""Laws of training and of the unconstrained dynamics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors.torch import load_file

from fairlead.core.errors import ArtifactError, FairleadError, UnknownNameError
from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome, Trajectories
from fairlead.geometry.distance import model_error
from fairlead.geometry.fields import BoxEnvironment
from fairlead.learning.checkpoint import read_snapshot
from fairlead.learning.dynamics import DynamicsConfig, Ensemble, LearnedDynamics, train_dynamics
from fairlead.learning.fit import CHECKPOINT, Stage, fit
from fairlead.learning.model_files import Job
from fairlead.learning.networks import NETWORKS
from fairlead.learning.registry import load_delta, load_dynamics
from fairlead.learning.rollout import Splits, Windows, roll_out_all
from fairlead.learning.rollout_task import RolloutTask
from rope_data import BOUNDS, LAYOUT, splits, straight_ropes

FREE = BoxEnvironment([], BOUNDS)
SMALL = DynamicsConfig(network="chain", hidden=32, members=3, stages=(Stage(3, 64), Stage(2, 32, 3e-4, 3)), patience=10)
DATA = splits(64, 6, 0)


def untrained(network: str, planar: bool) -> LearnedDynamics:
    """Weights at random everywhere: a network may begin with zeros in its last layer."""
    module = Ensemble(LAYOUT, DynamicsConfig(network, hidden=16, members=3, planar=planar), 1).eval()
    generator = torch.Generator().manual_seed(0)
    with torch.no_grad():
        for parameter in module.parameters():
            parameter.add_(0.1 * torch.randn(parameter.shape, generator=generator))
    return LearnedDynamics(module)


@pytest.mark.parametrize("network", NETWORKS)
@given(yaw=st.floats(-3.1, 3.1), shift=st.tuples(st.floats(-1, 1), st.floats(-1, 1)), seed=st.integers(0, 99))
@settings(max_examples=20, deadline=None)
def test_planar_dynamics_commute_with_planar_motions(
    network: str, yaw: float, shift: tuple[float, float], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])

    def moved(states: np.ndarray) -> np.ndarray:
        return (states.reshape(len(states), -1, 3) @ turn.T + [*shift, 0]).reshape(states.shape)

    states = straight_ropes(4, rng)
    actions = states[:, :3] + np.pad(rng.uniform(-0.1, 0.1, (4, 2)), ((0, 0), (0, 1)))
    dynamics = untrained(network, planar=True)
    here = dynamics.predict(FREE, states, actions)
    there = dynamics.predict(FREE, moved(states), moved(actions))
    np.testing.assert_allclose(there.mean, moved(here.mean), atol=1e-4)


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("network", NETWORKS)
def test_rows_are_independent_and_spread_is_the_sum_of_deviations(network: str, planar: bool) -> None:
    states = straight_ropes(5, np.random.default_rng(0))
    actions = states[:, :3] + 0.05
    dynamics = untrained(network, planar)
    whole = dynamics.predict(FREE, states, actions)
    alone = dynamics.predict(FREE, states[2:3], actions[2:3])
    np.testing.assert_allclose(alone.mean[0], whole.mean[2], atol=1e-5)
    members = torch.tensor(states).float().expand(3, -1, -1), torch.tensor(actions).float().expand(3, -1, -1)
    predicted = dynamics.module(*members).detach().numpy()
    assert np.abs(predicted[0] - predicted[1]).max() > 1e-4
    np.testing.assert_allclose(whole.mean, predicted.mean(0), atol=1e-6)
    np.testing.assert_allclose(whole.spread, predicted.std(0).sum(-1), atol=1e-5)


def test_members_see_the_same_data_in_different_order() -> None:
    windows = Windows(DATA.train)
    order = np.concatenate(windows.order(2, 32, 3, np.random.default_rng(0)), axis=1)
    assert not (order[0] == order[1]).all()
    for member in range(3):
        assert len(np.unique(order[member], axis=0)) == order.shape[1] == 64 * 5
    states, actions, _ = windows.at(order[:, :7], 2)
    first = order[1, 3]
    np.testing.assert_allclose(states[1, 3].numpy(), DATA.train.states[first[0], first[1] : first[1] + 3], rtol=1e-6)
    np.testing.assert_allclose(actions[1, 3].numpy(), DATA.train.actions[first[0], first[1] : first[1] + 2], rtol=1e-6)


def test_no_window_has_an_action_that_is_left_out() -> None:
    data = replace(DATA.train, outcomes=DATA.train.outcomes.copy())
    data.outcomes[0, 3] = data.outcomes[5, 0] = ActionOutcome.ARM_COLLISION.number
    every, left = (
        {tuple(window) for batch in Windows(data, leave_out=leave_out).order(2, 32, 1, np.random.default_rng(0))
         for window in batch[0]}
        for leave_out in ((), (ActionOutcome.ARM_COLLISION,))
    )  # fmt: skip
    assert every - left == {(0, 2), (0, 3), (5, 0)}


def weights_after(folder: Path, stop_at: int | None) -> tuple[dict[str, torch.Tensor], float]:
    """Weights after training in `folder`, which is interrupted at the score of epoch `stop_at`, and what `fit` says."""
    module = Ensemble(LAYOUT, SMALL, 0)
    dynamics = LearnedDynamics(module)
    task = RolloutTask(module, lambda s, a, *_: module(s, a), dynamics, DATA, SMALL.members, mirror=True)
    score, calls = task.score, 0

    def counted() -> float:
        nonlocal calls
        calls += 1
        if calls == stop_at:
            raise KeyboardInterrupt
        return score()

    task.score = counted
    earlier_s = fit(task, SMALL.stages, 3, folder, checkpoint_s=0.0)
    return module.state_dict(), earlier_s


@pytest.mark.parametrize("stop_at", [2, 4, 5])
def test_resumed_training_gives_the_same_weights(tmp_path: Path, stop_at: int) -> None:
    straight, nothing = weights_after(tmp_path / "straight", None)
    with pytest.raises(KeyboardInterrupt):
        weights_after(tmp_path / "stopped", stop_at)
    assert (tmp_path / "stopped" / CHECKPOINT).exists()
    resumed, earlier_s = weights_after(tmp_path / "stopped", None)
    assert nothing == 0 < earlier_s
    assert all(torch.equal(straight[name], resumed[name]) for name in straight)


def test_an_interrupt_keeps_what_epochs_have_done_however_short_the_time(tmp_path: Path) -> None:
    module = Ensemble(LAYOUT, SMALL, 0)
    task = RolloutTask(module, lambda s, a, *_: module(s, a), LearnedDynamics(module), DATA, SMALL.members)
    scores = iter([1.0, 0.9])

    def score() -> float:
        if (value := next(scores, None)) is None:
            raise KeyboardInterrupt
        return value

    task.score = score
    with pytest.raises(KeyboardInterrupt):
        fit(task, (Stage(4, 64),), 3, tmp_path, checkpoint_s=1e9)
    assert len(read_snapshot(tmp_path / CHECKPOINT, "").scalars["history"]) == 2


@pytest.mark.parametrize("network", NETWORKS)
@pytest.mark.parametrize("names", [("robot",), ("one", "other")])
def test_robots_that_hold_nothing_are_learned(network: str, names: tuple[str, ...]) -> None:
    layout, rng = StateLayout(names, 0), np.random.default_rng(0)
    moves = np.pad(rng.uniform(-0.1, 0.1, (4, 5, len(names), 2)), ((0, 0), (0, 0), (0, 0), (0, 1)))
    states = np.concatenate([np.zeros((4, 1, layout.state_size)), moves.reshape(4, 5, -1).cumsum(1)], axis=1)
    data = Trajectories(layout, states, states[:, 1:], np.zeros((4, 5), int), np.zeros(4, int), [FREE])
    module = Ensemble(layout, DynamicsConfig(network, hidden=16, members=2), 0)
    task = RolloutTask(module, lambda s, a, *_: module(s, a), LearnedDynamics(module), Splits(data, data, data), 2)
    stage = Stage(1, 8, horizon=2)
    loss = task.loss(stage, task.order(stage, rng)[0], rng)
    loss.backward()
    assert torch.isfinite(loss)
    assert all(torch.isfinite(weight.grad).all() for weight in module.parameters() if weight.grad is not None)
    assert np.isfinite(task.score())


def test_a_checkpoint_of_another_configuration_is_refused(tmp_path: Path) -> None:
    job = Job(tmp_path, "toy")
    module = Ensemble(LAYOUT, SMALL, 0)
    task = RolloutTask(module, lambda s, a, *_: module(s, a), LearnedDynamics(module), DATA, SMALL.members)
    fit(task, (Stage(1, 64),), 0, tmp_path, key=job.key("dynamics", SMALL))
    with pytest.raises(ArtifactError, match="another configuration"):
        train_dynamics(DATA, replace(SMALL, hidden=16), job)


def test_training_learns_saves_and_loads(tmp_path: Path) -> None:
    config = replace(SMALL, stages=(Stage(25, 64, 2e-3),))
    dynamics = train_dynamics(DATA, config, Job(tmp_path, "toy", seed=1, inputs={"phase1": "ab"}))
    predicted = roll_out_all(dynamics, DATA.validation, 6)
    errors = model_error(LAYOUT, predicted, DATA.validation.states[:, 1:])
    still = model_error(LAYOUT, DATA.validation.states[:, :1], DATA.validation.states[:, 1:])
    assert errors.mean() < 0.5 * still.mean()
    assert load_delta(tmp_path, "toy") == pytest.approx(np.percentile(errors, 90))
    loaded = load_dynamics(tmp_path, "toy")
    states, actions = DATA.test.states[:, 0], DATA.test.actions[:, 0]
    assert (loaded.predict(FREE, states, actions).mean == dynamics.predict(FREE, states, actions).mean).all()
    assert {"card.md", "curves.csv", "curves.png", "config.json", "metrics.json"} < {f.name for f in tmp_path.iterdir()}
    assert not (tmp_path / CHECKPOINT).exists()
    with pytest.raises(ArtifactError, match="scenario 'toy'"):
        load_dynamics(tmp_path, "dual_arm")
    weights = tmp_path / "model.safetensors"
    assert load_file(weights)
    weights.write_bytes(weights.read_bytes()[:-1])
    with pytest.raises(ArtifactError, match="damaged"):
        load_dynamics(tmp_path, "toy")


def test_mistakes_have_names(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'chain'"):
        DynamicsConfig(network="chian")
    with pytest.raises(FairleadError, match="positive"):
        Stage(0, 16)
    with pytest.raises(ArtifactError, match="not a finished model"):
        load_dynamics(tmp_path, "toy")
    bad = replace(DATA, train=replace(DATA.train, actions=DATA.train.actions * np.nan))
    with pytest.raises(FairleadError, match="loss became nan"):
        train_dynamics(bad, SMALL, Job(tmp_path / "nan", "toy"))
    bad = replace(DATA, validation=replace(DATA.validation, actions=DATA.validation.actions * np.nan))
    with pytest.raises(FairleadError, match="score became nan"):
        train_dynamics(bad, SMALL, Job(tmp_path / "unjudged", "toy"))
