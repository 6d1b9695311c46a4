"""What is not part of Fairlead is found by its name, and keeps the same contracts."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from fairlead.core import contracts, plugins
from fairlead.core.records import Transitions
from fairlead.core.streams import stream
from fairlead.evaluation.methods import Parts, find_method
from fairlead.evaluation.models import Models
from fairlead.geometry.shapes import Box
from fairlead.learning.dynamics import DynamicsConfig, Ensemble
from fairlead.learning.model_files import Job, save_model
from fairlead.scenarios.registry import scenario
from fakes import LAYOUT, FakeScenario, FakeWorld

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture
def _installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES))
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    points = [
        EntryPoint("clearance", "clearance_check:clearance", "fairlead.checks"),
        EntryPoint("fake", "fakes:FakeScenario", "fairlead.scenarios"),
    ]
    monkeypatch.setattr(plugins, "entry_points", lambda group: [p for p in points if p.group == group])
    yield
    sys.modules.pop("clearance_check", None)


@pytest.mark.usefixtures("_installed")
def test_an_installed_check_is_a_method_and_keeps_the_contract(tmp_path: Path) -> None:
    fake = scenario("fake")
    assert isinstance(fake, FakeScenario)
    method = find_method("clearance")
    settings = DynamicsConfig(hidden=8, blocks=1)
    tensors = Ensemble(LAYOUT, settings, seed=0).state_dict()
    save_model(Job(tmp_path / "dynamics", "fake"), "dynamics", settings.network, LAYOUT, settings, tensors, {}, 0.0)
    rng = stream(0, "plugins")
    scene = fake.random_scene(rng, "any")
    _, check, _ = Parts(Models(tmp_path, fake)).build(method, scene)
    states = rng.uniform(-0.5, 0.5, (12, LAYOUT.state_size))
    states.reshape(12, -1, 3)[..., 2] = 0.0
    actions = fake.sampler.propose(states, rng)
    transitions = Transitions(states, actions, states + 0.01, np.full(12, 0.1))
    contracts.check_transition_check(check, fake.environment(scene.obstacles), transitions)


@pytest.mark.usefixtures("_installed")
def test_the_example_trusts_what_is_clear_and_nothing_else() -> None:
    from clearance_check import Clearance

    fake, check = scenario("fake"), Clearance(LAYOUT, 0.05)
    wall = fake.environment(())
    box = type(wall)([Box((0.2, 2.0, 0.2), (0.5, 0.0, 0.0))], wall.bounds)
    states = np.zeros((3, LAYOUT.state_size))
    LAYOUT.points_of(states)[:, :, 0] = np.array([0.34, 0.36, 0.5])[:, None]
    encodings = check.encode(box, states)
    nowhere = np.zeros_like(encodings)
    transitions = Transitions(states, states[:, :3], states, np.zeros(3))
    np.testing.assert_array_equal(check.probability(box, transitions, nowhere, encodings), [1.0, 0.0, 0.0])


def test_the_world_of_the_fake_scenario_keeps_the_contract() -> None:
    fake, rng = FakeScenario(), stream(0, "fake")
    starts = np.stack([fake.random_start(rng) for _ in range(5)])
    contracts.check_world(FakeWorld([()] * 5, starts, 0.0), fake.sampler.propose(starts, rng))
