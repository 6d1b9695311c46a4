"""The table of scenarios. A new one is one file and one row here, or an entry point in `fairlead.scenarios`."""

from __future__ import annotations

from collections.abc import Callable

from fairlead.core import plugins
from fairlead.scenarios.dragging import Dragging
from fairlead.scenarios.dual_arm import DualArm
from fairlead.scenarios.scenario import Scenario

SCENARIOS: dict[str, Callable[[], Scenario]] = {"dragging": Dragging, "dual_arm": DualArm}


def scenario(name: str) -> Scenario:
    """The scenario of that name; UnknownNameError otherwise."""
    return plugins.find("scenario", name, SCENARIOS)()
