"""What comes with the package: trained models and benchmark scenes of each scenario."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from fairlead.core import plugins
from fairlead.core.errors import ArtifactError
from fairlead.scenarios.registry import SCENARIOS


def shipped_models(scenario: str) -> Path:
    """The folder of the trained models that come with the package.

    Raises:
        UnknownNameError: no scenario has that name.
        ArtifactError: none come for it.
    """
    return _found(scenario, f"pretrained/{scenario}", "--models DIR (fairlead reproduce trains them)")


def benchmark_scenes(scenario: str) -> Path:
    """The file of the benchmark scenes that come with the package; raises as `shipped_models`."""
    return _found(scenario, f"scenarios/scenes/{scenario}.json", "--scenes FILE (fairlead scenes draws them)")


def _found(scenario: str, name: str, instead: str) -> Path:
    plugins.find("scenario", scenario, SCENARIOS)
    path = Path(str(resources.files("fairlead"))) / name
    if not path.exists():
        raise ArtifactError(path, f"none come with Fairlead for {scenario}; give {instead}")
    return path
