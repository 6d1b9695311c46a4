"""Packed models answer as the originals do, are known as what they were made from, and never take another's place."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import load_file
from torch import nn

from fairlead.cli import main as cli
from fairlead.core.artifacts import MANIFEST, read_manifest, sha256, verify_files
from fairlead.core.errors import ArtifactError, UnknownNameError
from fairlead.evaluation import shipped
from fairlead.evaluation.methods import METHODS, Parts, find_method
from fairlead.evaluation.models import Models
from fairlead.evaluation.shipped import benchmark_scenes, shipped_models
from fairlead.learning.distilled import Distilled, DistilledConfig, Saved
from fairlead.learning.dynamics import Ensemble
from fairlead.learning.full_dynamics import FullNetwork
from fairlead.learning.model_files import Job, save_model
from fairlead.learning.packing import LOST
from fairlead.learning.recovery import RecoveryConfig
from fairlead.learning.recovery_networks import ChainRecovery, FrozenRecovery
from fairlead.learning.registry import load_dynamics
from fairlead.learning.trust import build_network
from fairlead.learning.trust_network import TrustConfig
from fairlead.reproduce import demo
from fairlead.reproduce import pack as packing
from fairlead.reproduce.pack import pack
from fairlead.reproduce.presets import preset
from fairlead.scenarios.registry import scenario

DRAGGING = scenario("dragging")
SMOKE = preset(DRAGGING, "smoke")
SCENES = DRAGGING.scenes(benchmark_scenes("dragging")).scenes
PRETRAINED = sorted(Path(shipped.__file__).parents[1].glob("pretrained/*"))


@dataclass(frozen=True)
class RecoveryAndTrust:
    recovery: RecoveryConfig
    trust: TrustConfig


def write(folder: Path, kind: str, config: Any, module: nn.Module, **metrics: Any) -> None:
    """A model as training writes it."""
    needs = {
        "distilled": ["dynamics"],
        "trust": ["dynamics"],
        "recovery": ["dynamics", folder.name.replace("recovery", "trust")],
    }.get(kind, [])
    inputs = {name.removesuffix("-sdf"): sha256(folder.parent / name / MANIFEST) for name in needs}
    job, network = Job(folder, "dragging", 3, inputs), getattr(config, "network", "voxel")
    save_model(job, kind, network, DRAGGING.layout, config, module.state_dict(), metrics, 1.0)


@pytest.fixture
def models(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Every model of a scenario, trained by nobody; compared on a few transitions."""
    monkeypatch.setattr(packing, "SCENES", 2)
    folder, layout = tmp_path / "models", DRAGGING.layout
    dynamics = Ensemble(layout, SMOKE.dynamics, 1)
    nn.init.normal_(dynamics.get_parameter("network.layers.last.weight"), 0, 0.01)
    write(folder / "dynamics", "dynamics", SMOKE.dynamics, dynamics, delta_m=0.05)
    write(folder / "full-dynamics", "full-dynamics", SMOKE.full_dynamics, FullNetwork(layout, SMOKE.full_dynamics))
    small = DistilledConfig(hidden=8)
    distilled = Distilled(layout, SMOKE.dynamics, small, 1)
    write(folder / "distilled", "distilled", Saved(small, SMOKE.dynamics), distilled)
    for suffix, config in (("", SMOKE.trust), ("-sdf", SMOKE.trust_sdf)):
        trust = build_network(layout, config, 1)
        both: nn.Module = ChainRecovery(trust) if suffix else FrozenRecovery(trust, SMOKE.recovery.hidden)  # type: ignore[arg-type]
        write(folder / f"trust{suffix}", "trust", config, trust, spread_threshold_m=0.01)
        write(folder / f"recovery{suffix}", "recovery", RecoveryAndTrust(SMOKE.recovery, config), both, trained=True)
    return folder


BIAS = "network.layers.first.bias"


def change(folder: Path, added: torch.Tensor | float) -> None:
    """Add to the first bias of the dynamics in `folder`."""
    module = Ensemble(DRAGGING.layout, SMOKE.dynamics, 1)
    module.load_state_dict(load_file(folder / "dynamics" / "model.safetensors"))
    with torch.no_grad():
        module.get_parameter(BIAS).add_(added)
    write(folder / "dynamics", "dynamics", SMOKE.dynamics, module, delta_m=0.05)


def test_packed_models_are_half_as_large_and_answer_alike(models: Path, tmp_path: Path) -> None:
    packed = pack(models, tmp_path / "packed")
    assert set(packed) == {"dynamics", "distilled", "full-dynamics", "trust", "trust-sdf", "recovery", "recovery-sdf"}
    for name, of in packed.items():
        assert of.halved, name
        assert 0 < of.difference <= LOST[of.kind]
        before, after = (
            (folder / name / "model.safetensors").stat().st_size for folder in (models, tmp_path / "packed")
        )
        assert after < 0.6 * before, name
    states = np.stack([scene.state(DRAGGING.layout) for scene in SCENES[:9]])
    actions = DRAGGING.sampler.propose(states, np.random.default_rng(0))
    nothing = DRAGGING.environment(())
    found = [
        load_dynamics(folder / "dynamics", "dragging").predict(nothing, states, actions).mean
        for folder in (models, tmp_path / "packed")
    ]
    assert found[0] == pytest.approx(found[1], abs=1e-4)


def test_packed_models_serve_every_method_and_keep_their_history(models: Path, tmp_path: Path) -> None:
    pack(models, tmp_path / "packed")
    parts = Parts(Models(tmp_path / "packed", DRAGGING))
    for method in METHODS:
        parts.build(find_method(method), SCENES[0])
    for folder in models.iterdir():
        packed = tmp_path / "packed" / folder.name
        before, after = (read_manifest(at, "model") for at in (folder, packed))
        verify_files(packed, after)
        assert (after.config, after.seed, after.inputs) == (before.config, before.seed, before.inputs)
        assert after.extra["packed_from"] == sha256(folder / MANIFEST)
        assert after.extra["packed_from"] in (packed / "card.md").read_text()
        assert not {"curves.csv", "curves.png"} & set(after.files)


def test_what_is_packed_already_is_copied_with_its_history(models: Path, tmp_path: Path) -> None:
    once, twice = tmp_path / "once", tmp_path / "twice"
    assert pack(models, once) == pack(once, twice)
    names = sorted(path.relative_to(once) for path in once.rglob("*") if path.is_file())
    assert names == sorted(path.relative_to(twice) for path in twice.rglob("*") if path.is_file())
    for name in names:
        assert (once / name).read_bytes() == (twice / name).read_bytes(), name


def test_a_classifier_is_refused_beside_dynamics_it_was_not_trained_on(models: Path, tmp_path: Path) -> None:
    pack(models, tmp_path / "packed")
    change(models, 0.1)
    with pytest.raises(ArtifactError, match="trained with another 'dynamics'"):
        pack(models, tmp_path / "mixed")
    assert not (tmp_path / "mixed").exists()
    (tmp_path / "packed" / "dynamics").rename(tmp_path / "set aside")
    (models / "dynamics").rename(tmp_path / "packed" / "dynamics")
    with pytest.raises(ArtifactError, match="trained with another 'dynamics'"):
        Models(tmp_path / "packed", DRAGGING).folder_of("trust")


def test_a_recovery_is_refused_beside_a_classifier_it_was_not_trained_for(models: Path, tmp_path: Path) -> None:
    assert Models(models, DRAGGING).folder_of("recovery-sdf")
    (models / "trust-sdf" / MANIFEST).write_text((models / "trust-sdf" / MANIFEST).read_text() + "\n")
    assert Models(models, DRAGGING).folder_of("recovery")
    with pytest.raises(ArtifactError, match=r"recovery-sdf: trained with another 'trust-sdf'"):
        Models(models, DRAGGING).folder_of("recovery-sdf")


BEYOND = 1e6 * torch.nn.functional.one_hot(torch.tensor(0), SMOKE.dynamics.hidden)


@pytest.mark.parametrize(("added", "halved"), [(BEYOND, True), (300.0, False)], ids=["range", "accuracy"])
def test_what_half_precision_would_harm_stays_as_it_is(
    models: Path, tmp_path: Path, added: torch.Tensor | float, halved: bool
) -> None:
    """A tensor with a number beyond the range stays in single; where rounding moves the answers, the model does."""
    lone, out = tmp_path / "lone", tmp_path / "packed"
    lone.mkdir()
    (models / "dynamics").rename(lone / "dynamics")
    change(lone, added)
    (of,) = pack(lone, out).values()
    tensors = load_file(out / "dynamics" / "model.safetensors")
    single = {name for name, tensor in tensors.items() if tensor.dtype == torch.float32}
    assert single == ({BIAS} if halved else set(tensors))
    assert of.halved == halved == (of.difference <= LOST["dynamics"])


def test_nothing_is_overwritten_and_nothing_half_written(models: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    with pytest.raises(ArtifactError, match="exists already"):
        pack(models, tmp_path / "mine")
    (models / "trust" / "model.safetensors").write_bytes(b"damaged")
    with pytest.raises(ArtifactError, match="damaged"):
        pack(models, tmp_path / "packed")
    assert not (tmp_path / "packed").exists()
    with pytest.raises(ArtifactError, match="no finished models"):
        pack(tmp_path / "mine", tmp_path / "packed")


def test_models_that_do_not_come_with_the_package_are_asked_for_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'dragging'"):
        shipped_models("draging")
    monkeypatch.setattr(shipped, "_PACKAGE", tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["fairlead", "plan", "dragging", "--scene", "s", "--trace", "t"])
    with pytest.raises(SystemExit, match="2"):
        cli.main()
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "none come with Fairlead for dragging; give --models DIR" in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("folder", PRETRAINED, ids=lambda folder: folder.name)
def test_the_models_that_come_with_the_package_are_whole_and_small(folder: Path) -> None:
    models = Models(folder, scenario(folder.name))
    scene = models.scenario.scenes(benchmark_scenes(folder.name)).scenes[0]
    for model in folder.glob("*/manifest.json"):
        verify_files(model.parent, read_manifest(models.folder_of(model.parent.name), "model"))
    for method in demo.METHODS[folder.name]:
        Parts(models).build(find_method(method), scene)
    assert sum(path.stat().st_size for path in folder.parent.rglob("*") if path.is_file()) < 30e6
