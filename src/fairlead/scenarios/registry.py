"""The table of scenarios. A new one is one file and one row here, or an entry point in `fairlead.scenarios`."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from fairlead.core import plugins
from fairlead.core.answers import expect_kind
from fairlead.core.errors import FairleadError
from fairlead.scenarios.dragging import Dragging
from fairlead.scenarios.dual_arm import DualArm
from fairlead.scenarios.fetch_cable import FETCH_CABLE
from fairlead.scenarios.scenario import Scenario
from fairlead.scenarios.task import Task
from fairlead.scenarios.under_hood import INSTALL_HOSE, MOVE_HOSE, REMOVE_STRAPS

TASKS = (FETCH_CABLE, MOVE_HOSE, INSTALL_HOSE, REMOVE_STRAPS)
"""The paper's mock-ups of real tasks; a new one is a `TaskSpec` here."""
SCENARIOS: dict[str, Callable[[], Scenario]] = {
    "dragging": Dragging,
    "dual_arm": DualArm,
    **{spec.name: partial(Task, spec) for spec in TASKS},
}


def scenario(name: str) -> Scenario:
    """The scenario of that name; UnknownNameError otherwise.

    Raises:
        FairleadError: what is installed under that name is no scenario, or calls itself otherwise.
    """
    build = plugins.find("scenario", name, SCENARIOS)
    found: Any = build() if callable(build) else build
    expect_kind(f"scenario '{name}'", found, Scenario)
    if found.name != name:
        raise FairleadError(f"scenario '{name}' calls itself '{found.name}': its name must be that of its entry point")
    return found


def scenario_fingerprint(name: str) -> str | None:
    """As `plugins.fingerprint`."""
    return plugins.fingerprint("scenario", name, SCENARIOS)
