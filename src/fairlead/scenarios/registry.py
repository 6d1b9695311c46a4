"""The table of scenarios. A new one is one file and one row here, or an entry point in `fairlead.scenarios`."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from fairlead.core import plugins
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
    """The scenario of that name; UnknownNameError otherwise."""
    return plugins.find("scenario", name, SCENARIOS)()
