"""Laws of recovery: what is paired with what, and what a label weighs."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any, final

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from jaxtyping import Float

from fairlead.core.contracts import check_recovery
from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome, Transitions
from fairlead.core.roles import Environment, TransitionCheck
from fairlead.geometry.motion import RandomDisplacement
from fairlead.learning.fit import Stage
from fairlead.learning.model_files import Job
from fairlead.learning.recovery import (
    LearnedRecovery,
    RecoveryConfig,
    RecoveryTask,
    train_recovery,
)
from fairlead.learning.recovery_networks import ChainRecovery, FrozenRecovery, carried_along
from fairlead.learning.registry import load_recovery
from fairlead.learning.stuck import RecoveryExamples, accepted, recovery_examples
from fairlead.learning.trust import LearnedCheck, build_network
from fairlead.learning.trust_network import TrustConfig
from fairlead.learning.voxels import VoxelGrid
from rope_data import LAYOUT, splits, straight_ropes, trajectories
from test_labels import FollowDynamics

SAMPLER = RandomDisplacement(LAYOUT, 0.15, (-0.9, -0.9, 0.02), (0.9, 0.9, 0.02), planar=True)
DYNAMICS = FollowDynamics(0.0)
CONFIG = RecoveryConfig(stages=(Stage(3, 32, 1e-3),))
VOXEL = TrustConfig("voxel", hidden=8, grid=VoxelGrid((24, 24, 1), 0.04))


class SideCheck(TransitionCheck):
    """Accepts what starts on the right of a line, whatever the action; if moody, nothing where all is on the right."""

    network: Any

    def __init__(self, line: float, moody: bool = False) -> None:
        self.line, self.moody = line, moody

    def encode(
        self,
        environment: Environment,
        states: Float[np.ndarray, "batch state"],
    ) -> Float[np.ndarray, "batch feature"]:
        return states[:, :1].astype(np.float32)

    def probability(
        self,
        environment: Environment,
        transitions: Transitions,
        encodings: Float[np.ndarray, "batch feature"],
        next_encodings: Float[np.ndarray, "batch feature"],
    ) -> Float[np.ndarray, " batch"]:
        assert (encodings == self.encode(environment, transitions.states)).all()
        right = encodings[:, 0] > self.line
        return (right & ~(self.moody and right.all())).astype(float)


def test_stuck_states_are_paired_with_their_action_successor_and_environment() -> None:
    data = trajectories(20, 8, 4, np.random.default_rng(0))
    found = recovery_examples(DYNAMICS, SideCheck(0.1), SAMPLER, data, 8, 10**6, 0.0, np.random.default_rng(1))
    stuck = data.states[:, :-1, 0] <= 0.1
    assert {tuple(row) for row in found.source.tolist()} == set(zip(*map(list, np.nonzero(stuck)), strict=True))
    for row, (n, t) in enumerate(found.source):
        np.testing.assert_array_equal(found.states[row], data.states[n, t])
        np.testing.assert_array_equal(found.actions[row], data.actions[n, t])
        assert found.scene[row] == data.scene[n]
        assert found.share[row] == float(data.states[n, t + 1, 0] > 0.1)
    assert set(found.share) == {0.0, 1.0}
    assert found.examined == 160
    counts = found.counts()
    assert (counts["examined"], counts["stuck"]) == (160, len(found))
    ones = int(found.share.sum())
    assert counts["labels"] == {"0": len(found) - ones, "below 1/2": 0, "1/2 and above": 0, "1": ones}


def test_what_leaves_the_bounds_is_not_accepted() -> None:
    far = RandomDisplacement(LAYOUT, 0.15, (-9, -9, 0.02), (9, 9, 0.02), planar=True)
    environment, starts = splits(8, 4, 2).train.environments[0], straight_ropes(40, np.random.default_rng(0))
    starts += np.tile([0.99 - starts[:, 0].max(), 0, 0], starts.shape[1] // 3)
    found = accepted(DYNAMICS, SideCheck(-9), far, environment, starts, 50, np.random.default_rng(1))
    targets = far.propose(np.repeat(starts, 50, axis=0), np.random.default_rng(1))
    assert 0 < found.sum() < found.size
    assert not found.ravel()[~environment.contains(np.tile(targets, starts.shape[1] // 3))].any()


def test_a_state_with_an_accepted_action_is_not_stuck_whatever_is_drawn_later() -> None:
    """Screening accepts actions on the right; those drawn for the labels there are all rejected."""
    data = trajectories(20, 8, 4, np.random.default_rng(0))
    found = recovery_examples(
        DYNAMICS, SideCheck(0.1, moody=True), SAMPLER, data, 8, 10**6, 0.0, np.random.default_rng(1)
    )
    assert (found.states[:, 0] <= 0.1).all()
    assert len(found) == (data.states[:, :-1, 0] <= 0.1).sum()
    assert not found.share.any()


@given(st.lists(st.floats(0, 1)))
def test_every_label_is_counted_once(share: list[float]) -> None:
    count = len(share)
    empty = np.zeros((count, 3))
    found = RecoveryExamples(empty, empty, np.array(share), np.zeros(count, int), np.zeros((count, 2), int), count)
    labels = found.counts()["labels"]
    assert sum(labels.values()) == count
    assert labels["0"] == share.count(0.0)
    assert labels["1"] == share.count(1.0)


@given(discount=st.floats(0, 0.99))
@settings(max_examples=10, deadline=None)
def test_a_discounted_label_is_the_best_of_what_comes_later_unless_the_action_was_cut_short(discount: float) -> None:
    data = trajectories(20, 8, 4, np.random.default_rng(0))
    cut = np.random.default_rng(2).random(data.outcomes.shape) < 0.3
    data.outcomes[cut] = ActionOutcome.STRETCH.number
    found = recovery_examples(DYNAMICS, SideCheck(0.1), SAMPLER, data, 8, 10**6, discount, np.random.default_rng(1))
    free = data.states[:, :, 0] > 0.1
    for label, (n, t) in zip(found.share, found.source, strict=True):
        later = np.flatnonzero(free[n, t + 1 :])
        credited = len(later) and (later[0] == 0 or not cut[n, t])
        assert label == pytest.approx(discount ** later[0] if credited else 0.0)


def test_a_few_transitions_of_many_scenes_may_be_examined() -> None:
    data = trajectories(20, 8, 10, np.random.default_rng(0))
    network = LearnedCheck(build_network(LAYOUT, TrustConfig("sdf", hidden=8), 0))
    found = recovery_examples(DYNAMICS, network, SAMPLER, data, 6, 3, 0.0, np.random.default_rng(1))
    assert found.examined == 8, "one trajectory at least"
    assert len(found) <= 8


@pytest.mark.parametrize(
    ("kind", "config"), [(ChainRecovery, TrustConfig("sdf", hidden=8)), (partial(FrozenRecovery, hidden=8), VOXEL)]
)
def test_every_row_is_judged_in_its_own_environment(kind: Any, config: TrustConfig) -> None:
    data = trajectories(12, 5, 3, np.random.default_rng(3))
    found = recovery_examples(DYNAMICS, SideCheck(0.0), SAMPLER, data, 4, 10**6, 0.0, np.random.default_rng(1))
    torch.manual_seed(0)
    network = kind(build_network(LAYOUT, config, 0)).eval()
    inputs = network.prepare(data.environments, found)
    with torch.inference_mode():
        together = network(*inputs(np.arange(len(found)))).numpy()
        assert together.std() > 1e-3
        for row in range(0, len(found), 5):
            n, t = found.source[row]
            actions = np.stack([data.actions[n, t], data.actions[n, t - 1]])[None]
            judged = network.judge(data.environments[data.scene[n]], data.states[n, t][None], actions).numpy()
            assert judged[0] == pytest.approx(together[row], abs=1e-4)
            assert judged[1] != pytest.approx(together[row], abs=1e-5)


def test_carried_along_each_end_goes_with_its_gripper() -> None:
    two = StateLayout(("left", "right"), 5)
    states, moves = np.random.default_rng(0).normal(size=(3, two.state_size)), np.array([[0.1, 0, 0], [0, 0.2, 0]])
    t = carried_along(two, states, states[:, :6] + moves.reshape(-1))
    points = two.points_of(t.next_states) - two.points_of(states)
    np.testing.assert_allclose(two.grippers_of(t.next_states) - two.grippers_of(states), np.tile(moves, (3, 1, 1)))
    np.testing.assert_allclose(points[:, [0, 2, 4]], np.tile([moves[0], moves.mean(0), moves[1]], (3, 1, 1)))
    one = carried_along(LAYOUT, states[:, : LAYOUT.state_size], states[:, :3] + moves[0])
    assert np.allclose(one.next_states - one.states, np.tile(moves[0], LAYOUT.state_size // 3))


def test_what_is_left_out_teaches_nothing() -> None:
    data = trajectories(20, 8, 4, np.random.default_rng(0))
    stopped = ActionOutcome.JOINT_LIMIT.number
    data.outcomes[::2] = stopped
    some = recovery_examples(DYNAMICS, SideCheck(0.1), SAMPLER, data, 8, 10**6, 0.0, np.random.default_rng(1),
                             {ActionOutcome.JOINT_LIMIT})  # fmt: skip
    every = recovery_examples(DYNAMICS, SideCheck(0.1), SAMPLER, data, 8, 10**6, 0.0, np.random.default_rng(1))
    kept = every.source[:, 0] % 2 == 1
    np.testing.assert_array_equal(some.source, every.source[kept])
    np.testing.assert_array_equal(some.share, every.share[kept])


def test_labels_zero_and_one_both_teach() -> None:
    network = FrozenRecovery(build_network(LAYOUT, VOXEL, 0), 4).eval()  # type: ignore[arg-type]
    head, same = network.head, torch.zeros(2, network.inputs)
    both = (lambda rows: (same[rows],)), np.array([0.0, 1.0])
    task = RecoveryTask(network, both, both)
    gradients = []
    for row in (0, 1):
        network.zero_grad()
        task.loss(Stage(1, 1), np.array([row]), np.random.default_rng(0)).backward()
        bias = head[-1].bias
        assert isinstance(bias, torch.Tensor)
        assert bias.grad is not None
        gradients.append(float(bias.grad))
    assert gradients[0] > 0.1
    assert gradients[1] < -0.1


class AwayCheck(SideCheck):
    """Accepts what starts with the gripper far enough from every obstacle."""

    def encode(
        self,
        environment: Environment,
        states: Float[np.ndarray, "batch state"],
    ) -> Float[np.ndarray, "batch feature"]:
        return environment.signed_distance(states[:, None, :3])


@pytest.mark.parametrize("network", ["sdf", "voxel"])
def test_training_learns_which_way_out_saves_and_loads(network: str, tmp_path: Path) -> None:
    """To the right for the paper's network, which knows where it is; away from obstacles for ours, which does not."""
    data = splits(240, 8, 4)
    check: Any = SideCheck(0.3) if network == "voxel" else AwayCheck(0.08)
    check.network = build_network(LAYOUT, VOXEL if network == "voxel" else TrustConfig("sdf", hidden=16), 0)
    settings = RecoveryConfig(samples=16, stages=(Stage(25, 64, 3e-3),), patience=25)
    stuck = recovery_examples(DYNAMICS, check, SAMPLER, data.train, 4, 10**6, 0.0, np.random.default_rng(0))
    assert 0.02 < stuck.share.mean() < 0.6

    policy = train_recovery(DYNAMICS, check, check, SAMPLER, data, settings, Job(tmp_path, "toy"))
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["trained"]
    gains, drawn = [], []
    for scene, environment in enumerate(data.test.environments[:4]):
        states = data.test.states[data.test.scene == scene, :-1].reshape(-1, LAYOUT.state_size)
        worth = check.encode(environment, states)[:, 0]
        states = states[worth < check.line]
        if not len(states):
            continue
        chosen = policy.choose(environment, states, np.random.default_rng(0))
        for actions, found in ((chosen, gains), (SAMPLER.propose(states, np.random.default_rng(0)), drawn)):
            moved = np.concatenate([actions, states[:, 3:]], axis=1)
            found += (check.encode(environment, moved) - check.encode(environment, states))[:, 0].tolist()
        check_recovery(policy, environment, states, LAYOUT)
        loaded = load_recovery(tmp_path, "toy", SAMPLER)
        assert (loaded.choose(environment, states, np.random.default_rng(0)) == chosen).all()
    assert np.mean(gains) > np.mean(drawn) + 0.03


def test_what_planning_asks_says_which_states_are_stuck(tmp_path: Path) -> None:
    data = splits(8, 4, 2)
    check = LearnedCheck(build_network(LAYOUT, TrustConfig("sdf", hidden=8), 0))
    everything = data.train.actions.shape[0] * data.train.actions.shape[1]
    train_recovery(DYNAMICS, check, SideCheck(9), SAMPLER, data, CONFIG, Job(tmp_path, "toy"))
    assert json.loads((tmp_path / "metrics.json").read_text())["train"]["stuck"] == everything


def test_nothing_to_learn_from_gives_random_actions_and_says_so(tmp_path: Path) -> None:
    data = splits(8, 4, 2)
    trust = LearnedCheck(build_network(LAYOUT, TrustConfig("sdf", hidden=8), 0))

    @final
    class Free(TransitionCheck):
        network = trust.network
        encode = SideCheck(-9).encode
        probability = SideCheck(-9).probability

    train_recovery(DYNAMICS, Free(), Free(), SAMPLER, data, CONFIG, Job(tmp_path, "toy"))  # type: ignore[arg-type]
    assert "acts at random" in (tmp_path / "card.md").read_text()
    assert json.loads((tmp_path / "metrics.json").read_text())["train"]["stuck"] == 0
    policy = load_recovery(tmp_path, "toy", SAMPLER)
    assert isinstance(policy, LearnedRecovery)
    states = data.test.states[:, 0]
    drawn = policy.choose(data.test.environments[0], states, np.random.default_rng(2))
    assert (drawn == SAMPLER.propose(states, np.random.default_rng(2))).all()
