"""What comes with the package, trained models and scenes of each scenario; and where the authors' scenes are."""

from __future__ import annotations

import os
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
    return _found(scenario, f"pretrained/{[*found, scenario][0]}", "give --models DIR (fairlead reproduce trains them)")


def benchmark_scenes(scenario: str) -> Path:
    """The file of the benchmark scenes that come with the package; raises as `shipped_models`."""
    return _found(scenario, f"scenarios/scenes/{scenario}.json", "give --scenes FILE (fairlead scenes draws them)")


def hard_scenes(scenario: str) -> Path:
    """The file of the hard scenes that come with the package; raises as `shipped_models`."""
    return _found(
        scenario,
        f"scenarios/scenes/{scenario}_hard.json",
        "fairlead scenes --hard draws some, and evaluate --scenes tries them",
    )


def authors_folder() -> Path:
    """Where the scene files of the paper's authors should be: they come with neither the package nor the repository."""
    return Path(os.environ.get("FAIRLEAD_AUTHORS_SCENES", _PACKAGE.parents[2] / "shared" / "scenes"))


def authors_scenes(scenario: str) -> Path:
    """The file of the authors' scenes; ArtifactError where it is not."""
    path = authors_folder() / f"{scenario}.json"
    if not path.exists():
        raise ArtifactError(path, "the authors' scenes are not there; set FAIRLEAD_AUTHORS_SCENES to their folder")
    return path


def _found(scenario: str, name: str, instead: str) -> Path:
    plugins.find("scenario", scenario, SCENARIOS)
    path = _PACKAGE / name
    if not path.exists():
        raise ArtifactError(path, f"none come with Fairlead for {scenario}; {instead}")
    return path
