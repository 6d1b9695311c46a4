"""Laws of the trust classifiers, the same for every network."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from fairlead.core.contracts import check_transition_check
from fairlead.core.errors import ArtifactError, FairleadError, UnknownNameError
from fairlead.core.layout import StateLayout
from fairlead.core.records import Transitions
from fairlead.geometry.fields import BoxEnvironment
from fairlead.geometry.shapes import Box
from fairlead.learning.fit import Stage
from fairlead.learning.labels import Examples, label
from fairlead.learning.model_files import Job
from fairlead.learning.registry import load_check
from fairlead.learning.trust import LearnedCheck, balanced_order, build_network, probabilities, train_trust
from fairlead.learning.trust_network import PAPER_GRID, TrustConfig
from fairlead.learning.trust_voxel import VoxelEncoder, transformed, transformed_grid
from fairlead.learning.voxels import Occupancy, VoxelGrid
from rope_data import BOUNDS, LAYOUT, splits
from test_labels import DELTA, FollowDynamics

DYNAMICS = FollowDynamics(0.002)
DATA = splits(60, 8, 8)
CONFIGS = {
    "sdf": TrustConfig("sdf", hidden=32, stages=(Stage(10, 64, 3e-3),)),
    "sdf-3d": TrustConfig("sdf", planar=False, hidden=16),
    "voxel": TrustConfig(
        "voxel", hidden=16, grid=VoxelGrid((24, 24, 1), 0.04), stages=(Stage(3, 32, 2e-3),), limit=400
    ),
    "voxel-3d": TrustConfig("voxel", planar=False, hidden=8, grid=VoxelGrid((22, 22, 22), 0.04)),
}


def shaken(config: TrustConfig) -> LearnedCheck:
    """An untrained check whose normalisation is not the identity."""
    network = build_network(LAYOUT, config, 0)
    generator = torch.Generator().manual_seed(0)
    for name, value in network.state_dict().items():
        if name.endswith(("mean", "scale", "running_var", "norm.weight", "norm.bias")):
            value.copy_(0.5 + torch.rand(value.shape, generator=generator))
    return LearnedCheck(network)


@pytest.mark.parametrize("name", CONFIGS)
def test_contract_and_planning_agree_with_training(name: str) -> None:
    check = shaken(CONFIGS[name])
    examples = label(DYNAMICS, DATA.test, DELTA)
    environment, rows = next(examples.by_scene())
    chosen = examples.take(rows[:6])
    check_transition_check(check, environment, chosen.transitions)
    t = chosen.transitions
    encodings = check.encode(environment, t.states), check.encode(environment, t.next_states)
    in_planning = check.probability(environment, t, *encodings)
    in_training = probabilities(check.network, check.network.prepare(chosen), len(chosen))
    np.testing.assert_allclose(in_planning, in_training, atol=1e-5)
    assert np.ptp(in_planning) > 1e-4


@pytest.mark.parametrize("name", ["sdf", "voxel"])
def test_not_a_number_is_not_accepted(name: str) -> None:
    check = shaken(CONFIGS[name])
    examples = label(DYNAMICS, DATA.test, DELTA)
    environment, rows = next(examples.by_scene())
    t = examples.take(rows[:3]).transitions
    t.next_states[1] = np.nan
    found = check.probability(
        environment, t, check.encode(environment, t.states), check.encode(environment, t.next_states)
    )
    assert not found[1] > 0.5
    assert np.isfinite(found[[0, 2]]).all()


@pytest.mark.parametrize(("grippers", "planar"), [(1, True), (1, False), (2, True), (2, False)])
def test_augmented_features_are_those_of_themirrored_and_exchanged_scene(grippers: int, planar: bool) -> None:
    layout, rng = StateLayout(("left", "right")[:grippers], 4), np.random.default_rng(0)
    network = build_network(layout, TrustConfig("sdf", planar=planar, hidden=8), 0)
    states, after = rng.uniform(-0.3, 0.3, (2, 40, layout.state_size))
    actions = rng.uniform(-0.3, 0.3, (40, layout.action_size))
    boxes = [Box((0.2, 0.3, 0.1), (0.1, 0.2, 0.0)), Box((0.1, 0.1, 0.4), (-0.2, 0.0, 0.1))]

    def features(mirror: bool, exchange: bool) -> tuple[np.ndarray, ...]:
        sign = np.array([1.0, -1.0 if mirror else 1.0, 1.0])
        order = [1, 0, *range(layout.state_size // 3 - 1, 1, -1)] if exchange else slice(None)
        seen = [(x.reshape(40, -1, 3) * sign)[:, order].reshape(40, -1) for x in (states, after)]
        asked = (actions.reshape(40, -1, 3) * sign)[:, :: -1 if exchange else 1].reshape(40, -1)
        world = BoxEnvironment([Box(b.size, tuple(sign * b.position)) for b in boxes], BOUNDS)
        t = Transitions(seen[0], asked, seen[1], np.linspace(0.01, 0.2, 40))
        return network._features(t, *(network.encode(world, x) for x in seen))

    changes = [features(m, e) for m in (False, True) for e in ((False, True) if grippers == 2 else (False,))]
    chain, whole = network.augment(tuple(map(torch.from_numpy, changes[0])), rng)
    off = [np.abs(chain.numpy() - c).max((1, 2)) + np.abs(whole.numpy() - w).max(1) for c, w in changes]
    nearest = np.argmin(off, axis=0)
    assert np.min(off, axis=0).max() < 1e-4
    assert set(nearest) == set(range(len(changes)))


def test_a_voxel_example_with_its_ends_exchanged_is_that_of_the_exchanged_object() -> None:
    layout, rng = StateLayout(("left", "right"), 4), np.random.default_rng(0)
    network = build_network(layout, TrustConfig("voxel", planar=False, hidden=8, grid=VoxelGrid((22,) * 3, 0.04)), 0)
    states, after = rng.uniform(-0.3, 0.3, (2, 3, layout.state_size))
    actions = rng.uniform(-0.3, 0.3, (3, layout.action_size))
    world = BoxEnvironment([Box((0.2, 0.3, 0.1), (0.1, 0.2, 0.0))], 3 * BOUNDS)

    def inputs(order: list[int]) -> tuple[torch.Tensor, ...]:
        seen = [x.reshape(3, -1, 3)[:, order].reshape(3, -1) for x in (states, after)]
        t = Transitions(seen[0], actions.reshape(3, -1, 3)[:, order[:2]].reshape(3, -1), seen[1], np.full(3, 0.1))
        zeros = np.zeros(3, int)
        examples = Examples(
            layout, [world], t, np.ones(3, bool), np.zeros(3), np.zeros(3), zeros, np.zeros((3, 3), int)
        )
        return network.prepare(examples)(np.arange(3))

    straight, exchanged = inputs([0, 1, 2, 3, 4, 5]), inputs([1, 0, 5, 4, 3, 2])
    draws = [network.augment(straight, np.random.default_rng(seed)) for seed in range(64)]

    def alike(drawn: tuple[torch.Tensor, ...], expected: tuple[torch.Tensor, ...], row: int) -> bool:
        return all(torch.allclose(x[:, row], y[:, row], atol=1e-5) for x, y in zip(drawn, expected, strict=True))

    for expected, row in itertools.product((straight, exchanged), range(3)):
        of_row = [alike(drawn, expected, row) for drawn in draws]
        assert any(of_row)
        assert any(found and not alike(drawn, expected, row - 1) for found, drawn in zip(of_row, draws, strict=True))
    fixed = replace(network.config, reach_known=False)
    network.config = fixed
    assert network.augment(straight, rng) is straight


@pytest.mark.parametrize("symmetry", list(itertools.product([0, 1], repeat=3)))
def test_a_transformed_grid_is_the_grid_of_the_transformed_scene(symmetry: tuple[int, int, int]) -> None:
    code = np.array(symmetry)
    rng = np.random.default_rng(0)
    grid = VoxelGrid((12, 12, 1), 0.05, 300.0)
    bounds = np.array([[-1.025, -1.025, 0.0], [1.025, 1.025, 0.04]])  # a cell's centre at the origin

    def moved(points: np.ndarray) -> np.ndarray:
        return transformed(torch.from_numpy(points).unflatten(-1, (-1, 3)), code).flatten(-2).numpy()

    states = np.tile(rng.uniform(-0.5, 0.5, (4, 3)), 6) + rng.uniform(-0.2, 0.2, (4, 18))
    boxes = [Box((0.22, 0.31, 0.2), (0.21, -0.13, 0.1)), Box((0.3, 0.1, 0.2), (-0.3, 0.33, 0.1))]
    sizes = [(b.size[1], b.size[0], b.size[2]) if symmetry[2] else b.size for b in boxes]
    turned = [Box(size, tuple(moved(np.array(b.position)))) for b, size in zip(boxes, sizes, strict=True)]
    drawn, expected = (
        grid.draw(LAYOUT, Occupancy.of([BoxEnvironment(b, bounds)], 0.05), np.zeros(4, int), s).numpy()
        for b, s in ((boxes, states), (turned, moved(states)))
    )
    found = transformed_grid(torch.from_numpy(drawn), code).numpy()
    np.testing.assert_allclose(found[:, :, 1:, 1:], expected[:, :, 1:, 1:], atol=1e-4)


@pytest.mark.parametrize("name", ["sdf", "voxel"])
def test_training_separates_saves_and_loads(name: str, tmp_path: Path) -> None:
    check = train_trust(DYNAMICS, DATA, DELTA, CONFIGS[name], Job(tmp_path, "toy", seed=2))
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["train"]["auroc"] > 0.8
    assert metrics["delta_m"] == DELTA
    assert set(metrics["rules"]) == {"figure", "text"}
    loaded = load_check(tmp_path, "toy")
    examples = label(DYNAMICS, DATA.test, DELTA)
    environment, rows = next(examples.by_scene())
    states = examples.take(rows[:5]).transitions.states
    assert (loaded.encode(environment, states) == check.encode(environment, states)).all()
    with pytest.raises(ArtifactError, match="scenario 'toy'"):
        load_check(tmp_path, "dual_arm")


def test_networks_are_judged_on_the_same_examples_whatever_they_were_trained_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fairlead.learning.trust.HELD_OUT", 200)
    judged = []
    for name, limit in (("sdf", 300), ("voxel", 100)):
        config = replace(CONFIGS[name], limit=limit, stages=(Stage(1, 64),))
        train_trust(DYNAMICS, DATA, DELTA, config, Job(tmp_path / name, "toy", seed=2))
        metrics = json.loads((tmp_path / name / "metrics.json").read_text())
        assert metrics["train"]["examples"] == limit
        shown = {key: metrics[key]["reliable_share"] for key in ("validation", "test")}
        judged.append({**shown, "n": metrics["test"]["examples"], "spread": metrics["spread_threshold_m"]})
    assert judged[0] == judged[1]
    assert judged[0]["n"] == 200


def test_minibatches_are_balanced_and_use_every_example() -> None:
    labels = np.random.default_rng(0).random(1000) < 0.85
    batches = balanced_order(labels, 50, np.random.default_rng(1))
    assert all(abs(labels[rows].mean() - 0.5) < 0.03 for rows in batches)
    assert set(np.concatenate(batches)) == set(range(1000))


def test_paper_encoder_has_the_papers_size() -> None:
    dragging = VoxelEncoder(3, PAPER_GRID, planar=True)
    assert dragging.size == 4 * 26 * 10 * 10
    assert VoxelEncoder(4, VoxelGrid((40, 40, 40), 0.02), planar=False).size == 26 * 3**3


def test_layers_of_a_planar_grid_are_a_convolution_of_3_by_3_by_1() -> None:
    encoder = VoxelEncoder(3, VoxelGrid((22, 22, 2), 0.01), planar=True)
    voxels = torch.rand(2, 3, 22, 22, 2, generator=torch.Generator().manual_seed(0))
    expected = voxels
    for layer in encoder.layers:
        if isinstance(layer, torch.nn.Conv2d):
            expected = torch.nn.functional.conv3d(expected, layer.weight[..., None], layer.bias).relu()
            expected = torch.nn.functional.max_pool3d(expected, (2, 2, 1))
    expected = expected.permute(0, 4, 1, 2, 3).flatten(1)
    torch.testing.assert_close(encoder(voxels), expected, atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("planar", [True, False])
def test_features_of_a_grid_do_not_depend_on_how_many_are_encoded_at_once(
    planar: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    grid = VoxelGrid((22, 22, 2 if planar else 22), 0.01)
    encoder = VoxelEncoder(3, grid, planar)
    voxels = torch.rand(7, 3, *grid.shape, generator=torch.Generator().manual_seed(0))
    together = encoder(voxels)
    monkeypatch.setattr("fairlead.learning.trust_voxel.AT_ONCE", 2 * math.prod(grid.shape))
    torch.testing.assert_close(encoder(voxels), together, atol=1e-5, rtol=1e-4)
    assert encoder(voxels[:0]).shape == (0, encoder.size)
    with torch.inference_mode():  # another layout of memory
        torch.testing.assert_close(encoder(voxels), together, atol=1e-5, rtol=1e-4)
        assert encoder(voxels[:0]).shape == (0, encoder.size)


def test_mistakes_have_names() -> None:
    with pytest.raises(UnknownNameError, match="trust network 'voxels'"):
        TrustConfig("voxels")
    with pytest.raises(UnknownNameError, match="labelling rule"):
        TrustConfig(rule="fig")
    with pytest.raises(FairleadError, match="too small"):
        build_network(LAYOUT, TrustConfig("voxel", grid=VoxelGrid((10, 10, 1), 0.02)), 0)
    free = splits(8, 4, 0)
    with pytest.raises(FairleadError, match="every training example is reliable"):
        train_trust(FollowDynamics(0.0), free, DELTA, CONFIGS["sdf"], Job(Path("/nonexistent"), "toy"))
