"""Models by folder: what `train` wrote, as the roles that planning and execution ask for."""

from __future__ import annotations

from pathlib import Path

from fairlead.core.roles import Dynamics
from fairlead.learning.dynamics import dynamics_from
from fairlead.learning.model_files import read_model
from fairlead.learning.trust import LearnedCheck, check_from


def load_dynamics(folder: Path, scenario: str) -> Dynamics:
    """The unconstrained dynamics in `folder`, trained for `scenario`."""
    return dynamics_from(read_model(folder, "dynamics", scenario))


def load_delta(folder: Path, scenario: str) -> float:
    """The distance [m] within which a prediction of these dynamics counts as reliable."""
    return float(read_model(folder, "dynamics", scenario).metrics["delta_m"])


def load_check(folder: Path, scenario: str) -> LearnedCheck:
    """The trust classifier in `folder`, trained for `scenario`."""
    return check_from(read_model(folder, "trust", scenario))
