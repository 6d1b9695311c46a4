"""What is not part of Fairlead is found by its name, and keeps the same contracts."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from fairlead.core import contracts, plugins
from fairlead.core.artifacts import sha256
from fairlead.core.errors import FairleadError
from fairlead.core.records import Transitions
from fairlead.core.streams import stream
from fairlead.evaluation.methods import DYNAMICS, Method, Parts, find_method, method_names
from fairlead.evaluation.models import Models
from fairlead.geometry.shapes import Box
from fairlead.learning.dynamics import DynamicsConfig, Ensemble
from fairlead.learning.model_files import Job, save_model
from fairlead.planning.checks import AcceptAll
from fairlead.planning.recovery import RandomRecovery
from fairlead.scenarios.registry import scenario
from fakes import LAYOUT, FakeScenario, FakeWorld

EXAMPLES = Path(__file__).parents[1] / "examples"
PARTS = """
import numpy as np
from fairlead.core.records import Prediction
from fairlead.core.roles import Dynamics
from fairlead.evaluation.methods import Method

class Still(Dynamics):
    def __init__(self, layout):
        self.kept = layout

    @property
    def layout(self):
        return self.kept

    def predict(self, environment, states, actions):
        return Prediction(states.copy(), np.zeros(len(states)))

def still(models):
    return Still(models.scenario.layout)

def nothing(models):
    return None

STILL = Method("still", "accept-all", "random", "Nothing ever moves.")
"""


@pytest.fixture
def _installed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    monkeypatch.syspath_prepend(str(EXAMPLES))
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    points = [
        EntryPoint("clearance", "clearance_check:clearance", "fairlead.checks"),
        EntryPoint("fake", "fakes:FakeScenario", "fairlead.scenarios"),
        EntryPoint("alias", "fakes:FakeScenario", "fairlead.scenarios"),
        EntryPoint("layout", "fakes:LAYOUT", "fairlead.scenarios"),
        EntryPoint("still", "parts_of_ones_own:still", "fairlead.dynamics"),
        EntryPoint("nothing", "parts_of_ones_own:nothing", "fairlead.checks"),
        EntryPoint("still+all", "parts_of_ones_own:STILL", "fairlead.methods"),
        EntryPoint("untyped", "parts_of_ones_own:nothing", "fairlead.methods"),
        EntryPoint("broken", "parts_that_break:anything", "fairlead.checks"),
    ]
    monkeypatch.setattr(plugins, "entry_points", lambda group: [p for p in points if p.group == group])
    (tmp_path / "parts_of_ones_own.py").write_text(PARTS)
    (tmp_path / "parts_that_break.py").write_text("1 / 0\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield
    for module in ("clearance_check", "parts_of_ones_own", "parts_that_break"):
        sys.modules.pop(module, None)


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


@pytest.mark.usefixtures("_installed")
def test_dynamics_and_methods_are_installed_too_and_their_version_is_known(tmp_path: Path) -> None:
    fake, method = scenario("fake"), find_method("still+all")
    assert {"still+all", "clearance"} < set(method_names())
    models = Models(tmp_path / "none", fake)
    dynamics, check, recovery = Parts(models).build(method, fake.random_scene(stream(0), "scene"))
    assert type(dynamics).__name__ == "Still"
    assert isinstance(check, AcceptAll)
    assert isinstance(recovery, RandomRecovery)
    assert models.hashes == {"dynamics still": sha256(tmp_path / "parts_of_ones_own.py")}
    assert plugins.fingerprint("dynamics", "learned", DYNAMICS) is None


@pytest.mark.usefixtures("_installed")
def test_what_is_installed_and_no_good_is_named(tmp_path: Path) -> None:
    fake = scenario("fake")
    scene, parts = fake.random_scene(stream(0), "scene"), Parts(Models(tmp_path / "none", fake))
    with pytest.raises(FairleadError, match="check 'nothing' is a NoneType; a TransitionCheck is needed"):
        parts.build(Method("still", "nothing", "none", ""), scene)
    with pytest.raises(FairleadError, match=r"check 'broken' \(parts_that_break:anything\) cannot .* Zero"):
        parts.build(Method("still", "broken", "none", ""), scene)
    with pytest.raises(FairleadError, match="method 'untyped' is a function; a Method is needed"):
        find_method("untyped")
    with pytest.raises(FairleadError, match="scenario 'alias' calls itself 'fake'"):
        scenario("alias")
    with pytest.raises(FairleadError, match="scenario 'layout' is a StateLayout; a Scenario is needed"):
        scenario("layout")
