"""What comes with the package: trained models and benchmark scenes of each scenario."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from fairlead.core import plugins
from fairlead.core.errors import ArtifactError
from fairlead.scenarios.registry import SCENARIOS
from fairlead.scenarios.registry import scenario as find_scenario

_PACKAGE = Path(str(resources.files("fairlead")))


def shipped_models(scenario: str) -> Path:
    """The folder of the trained models that come with the package; for a task without, those of its base.

    Raises:
        UnknownNameError: no scenario has that name.
        ArtifactError: none come for it.
    """
    found = [name for name in find_scenario(scenario).kin if (_PACKAGE / "pretrained" / name).exists()]
    return _found(scenario, f"pretrained/{[*found, scenario][0]}", "--models DIR (fairlead reproduce trains them)")


def benchmark_scenes(scenario: str) -> Path:
    """The file of the benchmark scenes that come with the package; raises as `shipped_models`."""
    return _found(scenario, f"scenarios/scenes/{scenario}.json", "--scenes FILE (fairlead scenes draws them)")


def _found(scenario: str, name: str, instead: str) -> Path:
    plugins.find("scenario", scenario, SCENARIOS)
    path = _PACKAGE / name
    if not path.exists():
        raise ArtifactError(path, f"none come with Fairlead for {scenario}; give {instead}")
    return path
