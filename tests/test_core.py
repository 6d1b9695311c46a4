"""Laws of core: named streams, budgets, state layouts, plug-ins, and the import contract."""

from __future__ import annotations

import configparser
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import fairlead
from fairlead.core import cores, plugins
from fairlead.core.budget import Budget, Meter
from fairlead.core.errors import FairleadError, UnknownNameError
from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome, PlanOutcome, TrialOutcome
from fairlead.core.streams import stream, stream_seed

names = st.lists(st.one_of(st.text("abc", min_size=1, max_size=3), st.integers(0, 99)), max_size=3)


@given(seed=st.integers(0, 2**32), one=names, two=names)
def test_a_stream_depends_on_its_seed_and_on_every_name(seed: int, one: list[str | int], two: list[str | int]) -> None:
    assert stream_seed(seed, *one) == stream_seed(seed, *one)
    assert stream_seed(seed, *one) != stream_seed(seed + 1, *one)
    if list(map(str, one)) != list(map(str, two)):
        assert stream_seed(seed, *one) != stream_seed(seed, *two)


def test_streams_are_the_same_on_every_machine_and_leave_the_global_generator_alone() -> None:
    assert stream_seed(0, "actions", 1, 2) == 7583918611394820182
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    stream(0, "x").random(100)
    np.testing.assert_array_equal(before, np.random.get_state()[1])  # noqa: NPY002


def test_streams_of_different_names_are_uncorrelated() -> None:
    draws = np.stack([stream(0, "lane", i).normal(size=4000) for i in range(8)])
    correlation = np.corrcoef(draws) - np.eye(8)
    assert np.abs(correlation).max() < 0.08


@given(unit=st.sampled_from(["seconds", "extensions"]), number=st.integers(1, 10**12))
def test_a_budget_survives_writing_and_reading(unit: str, number: int) -> None:
    assert Budget.parse(f"{unit}={number}") == Budget(**{unit: float(number)})
    assert str(Budget.parse(f"{unit}={number}")) == f"{unit}={number}"


@pytest.mark.parametrize(
    "text", ["", "180", "seconds=", "seconds=-1", "seconds=0", "hours=3", "seconds=nan", "seconds=inf"]
)
def test_a_wrong_budget_is_a_users_mistake(text: str) -> None:
    with pytest.raises(FairleadError, match="budget"):
        Budget.parse(text)


def test_a_budget_has_exactly_one_limit() -> None:
    for limits in ({}, {"seconds": 1.0, "extensions": 1.0}):
        with pytest.raises(FairleadError, match="one positive number"):
            Budget(**limits)


class Ticks:
    """A clock that a test moves."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


@given(spans=st.lists(st.tuples(st.booleans(), st.floats(0, 10)), max_size=8), limit=st.floats(1, 40))
def test_a_meter_adds_planning_and_execution_and_nothing_between(spans: list[tuple[bool, float]], limit: float) -> None:
    clock = Ticks()
    meter = Meter(Budget(seconds=limit), clock)
    for planning, seconds in spans:
        if planning:
            meter.start_planning()
            clock.now += seconds
            running = meter.spent_s
            meter.stop_planning()
            assert meter.spent_s == pytest.approx(running)
        else:
            clock.now += 100.0  # idle wall time costs nothing
            meter.charge_execution(seconds)
    assert meter.spent_s == pytest.approx(sum(seconds for _, seconds in spans))
    assert meter.exhausted == (meter.spent_s >= limit)


def test_extensions_exhaust_their_budget_at_the_count_and_time_does_not() -> None:
    meter = Meter(Budget(extensions=10), Ticks())
    meter.charge_execution(1e9)
    meter.charge_extensions(9)
    assert not meter.exhausted
    meter.charge_extensions(1)
    assert meter.exhausted


@given(grippers=st.integers(1, 3), points=st.integers(0, 30), batch=st.lists(st.integers(0, 3), max_size=2))
def test_layout_round_trip(grippers: int, points: int, batch: list[int]) -> None:
    layout = StateLayout(tuple(f"g{i}" for i in range(grippers)), points)
    states = np.random.default_rng(0).normal(size=(*batch, layout.state_size))
    np.testing.assert_array_equal(layout.join(layout.grippers_of(states), layout.points_of(states)), states)
    assert layout.state_size == 3 * (grippers + points)
    assert layout.action_size == 3 * grippers
    assert sum(layout.parts) == layout.state_size


def test_a_robot_that_holds_nothing_is_its_own_object() -> None:
    layout, states = StateLayout(("one", "other"), 0), np.arange(12.0).reshape(2, 6)
    np.testing.assert_array_equal(layout.object_of(states), layout.grippers_of(states))
    assert [layout.held(layout.index(name)) for name in layout.grippers] == [0, 1]
    for target in ("tail", 0):
        with pytest.raises(UnknownNameError, match=r"allowed: one, other$"):
            layout.index(target)


@pytest.mark.parametrize("kind", [ActionOutcome, PlanOutcome, TrialOutcome])
def test_outcomes_have_a_label_of_their_own_and_a_sentence(kind: type[ActionOutcome]) -> None:
    labels = [member.label for member in kind]
    assert len(set(labels)) == len(labels)
    for member in kind:
        assert kind.of(member.label) is member
        assert member.sentence.endswith(".")


def test_own_names_are_found_first_and_then_those_of_other_distributions(monkeypatch: pytest.MonkeyPatch) -> None:
    points = [
        EntryPoint("budget", "fairlead.core.budget:Budget", "fairlead.checks"),
        EntryPoint("mine", "fairlead.core.budget:Meter", "fairlead.checks"),
        EntryPoint("broken", "no_such_module:Thing", "fairlead.checks"),
    ]
    monkeypatch.setattr(plugins, "entry_points", lambda group: points if group == "fairlead.checks" else [])
    own = {"mine": 1}
    assert plugins.find("check", "mine", own) == 1
    assert plugins.find("check", "budget", own) is Budget
    assert plugins.names("check", own) == ["broken", "budget", "mine"]
    with pytest.raises(FairleadError, match=r"check 'broken' .* cannot be loaded"):
        plugins.find("check", "broken", own)
    with pytest.raises(UnknownNameError, match=r"did you mean 'mine'\?\); allowed: broken, budget, mine"):
        plugins.find("check", "min", own)


REPOSITORY = Path(__file__).parents[1]


def packages() -> set[str]:
    folders = (REPOSITORY / "src" / "fairlead").iterdir()
    return {folder.name for folder in folders if (folder / "__init__.py").exists()}


def test_every_package_has_a_place_in_the_import_contract() -> None:
    contract = configparser.ConfigParser()
    contract.read(REPOSITORY / ".importlinter")

    def members(section: str, key: str) -> set[str]:
        return set(contract[f"importlinter:contract:{section}"][key].replace("|", " ").replace("fairlead.", "").split())

    assert members("layers", "layers") == {*packages(), "__main__"}
    assert members("mujoco", "source_modules") == packages() - {"scenarios"}
    assert members("torch", "source_modules") == packages() - {"learning"}
    assert not {"util", "utils", "common", "helpers", "misc"} & packages()


def test_the_version_is_the_same_wherever_it_stands() -> None:
    assert (REPOSITORY / "CHANGELOG.md").read_text().count(f"## {fairlead.__version__}") == 1
    assert f"version: {fairlead.__version__}\n" in (REPOSITORY / "CITATION.cff").read_text()


@pytest.mark.parametrize(("quota", "share"), [("max 100000", 4), ("200000 100000", 2), ("50000 100000", 1)])
def test_a_container_has_no_more_cores_than_its_share(quota: str, share: int, tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "cpu.max").write_text(quota + "\n")
    monkeypatch.setattr(cores, "CPU_MAX", tmp_path / "cpu.max")
    monkeypatch.setattr(cores.os, "sched_getaffinity", lambda process: set(range(4)), raising=False)
    assert cores.cores() == share
