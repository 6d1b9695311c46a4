"""Models by folder: what training wrote, as the roles that planning and execution ask for."""

from __future__ import annotations

from pathlib import Path

import torch

from fairlead.core.errors import FairleadError
from fairlead.core.roles import ActionSampler, Dynamics
from fairlead.learning.device import CPU
from fairlead.learning.distilled import distilled_from
from fairlead.learning.dynamics import Ensemble, LearnedDynamics, dynamics_from
from fairlead.learning.full_dynamics import full_dynamics_from
from fairlead.learning.model_files import Names, read_model
from fairlead.learning.recovery import LearnedRecovery, recovery_from
from fairlead.learning.trust import LearnedCheck, check_from


def use_threads(count: int) -> None:
    """Let torch use so many threads in this process. A trial's worker uses one; training may use all cores."""
    if count < 1:
        raise FairleadError(f"threads {count}: at least 1 is needed")
    torch.set_num_threads(count)


def load_dynamics(folder: Path, scenario: Names, device: torch.device = CPU) -> LearnedDynamics[Ensemble]:
    """The unconstrained dynamics in `folder`, trained for `scenario`."""
    return dynamics_from(read_model(folder, "dynamics", scenario), device)


def load_distilled(folder: Path, scenario: Names) -> Dynamics:
    """The distilled dynamics in `folder`, trained for `scenario`."""
    return distilled_from(read_model(folder, "distilled", scenario))


def load_full_dynamics(folder: Path, scenario: Names) -> Dynamics:
    """The full dynamics baseline in `folder`, trained for `scenario`."""
    return full_dynamics_from(read_model(folder, "full-dynamics", scenario))


def load_delta(folder: Path, scenario: Names) -> float:
    """The distance [m] within which a prediction of the unconstrained dynamics in `folder` counts as reliable."""
    return float(read_model(folder, "dynamics", scenario).metrics["delta_m"])


def load_check(folder: Path, scenario: Names, device: torch.device = CPU) -> LearnedCheck:
    """The trust classifier in `folder`, trained for `scenario`."""
    return check_from(read_model(folder, "trust", scenario), device)


def load_recovery(folder: Path, scenario: Names, sampler: ActionSampler) -> LearnedRecovery:
    """The recovery policy in `folder`, trained for `scenario`; it chooses among actions that `sampler` proposes."""
    return recovery_from(read_model(folder, "recovery", scenario), sampler)
