"""The trained models of a scenario, found by the names of their folders and checked to fit each other."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import final

from fairlead.core.artifacts import MANIFEST, read_json, read_manifest, sha256
from fairlead.core.errors import ArtifactError
from fairlead.core.roles import ActionSampler
from fairlead.learning.packing import PACKED_FROM
from fairlead.planning.memory import CutShort, UntriedActions
from fairlead.scenarios.scenario import Scenario


@final
class Models:
    """The trained models of a scenario, in the folders of one folder; each is read when a method asks for it.

    Folders: dynamics, distilled, full-dynamics, trust, trust-sdf, recovery, recovery-sdf. `hashes` maps the name of
    each that was asked for to the SHA-256 of its manifest, `settings` what was read from them besides to its value.
    `sampler` draws the actions of planning and recovery as the scenario does, or, where a trial is to `remember`, keeps
    away from those that it has `tried`. The learned dynamics are the ensemble, or what was `distilled` from it.
    """

    def __init__(
        self,
        folder: Path,
        scenario: Scenario,
        tried: CutShort | None = None,
        remember: bool = False,
        distilled: bool = False,
    ) -> None:
        self.folder, self.scenario, self.distilled = folder, scenario, distilled
        self.tried, self.remember = tried or CutShort(scenario.layout), remember
        self.sampler: ActionSampler = UntriedActions(scenario.sampler, self.tried) if remember else scenario.sampler
        self.hashes: dict[str, str] = {}
        self.settings: dict[str, float] = {}

    def folder_of(self, name: str) -> Path:
        """The folder of a finished model.

        Raises:
            ArtifactError: there is none, or it was trained on dynamics or for a classifier other than those beside it,
                whose predictions and delta may differ.
        """
        folder = self.folder / name
        if not (folder / MANIFEST).exists():
            there = ", ".join(sorted(path.parent.name for path in self.folder.glob(f"*/{MANIFEST}"))) or "none"
            raise ArtifactError(folder, f"no finished model; here are: {there}; train it, or choose another --models")
        manifest, layout = read_manifest(folder, "model"), self.scenario.layout
        made_from, states = manifest.inputs, manifest.config["layout"]
        if states != {"grippers": list(layout.grippers), "points": layout.points}:
            now = f"those of '{self.scenario.name}' are {layout}"
            raise ArtifactError(folder, f"its states are {states}, {now}; train it again")
        for kind, model in (("dynamics", "dynamics"), ("trust", name.replace("recovery", "trust"))):
            if kind in made_from and made_from[kind] not in _names_of(self.folder_of(model)):
                raise ArtifactError(folder, f"trained with another '{model}' than the one beside it; train it again")
        self.hashes[name] = sha256(folder / MANIFEST)
        return folder

    @cached_property
    def spread_threshold_m(self) -> float:
        """The trusted spread: the best balanced accuracy on the validation labels of a classifier's training."""
        for name in ("trust-sdf", "trust"):
            if (self.folder / name / MANIFEST).exists():
                threshold = float(read_json(self.folder_of(name) / "metrics.json")["spread_threshold_m"])
                self.settings["spread_threshold_m"] = threshold
                return threshold
        raise ArtifactError(self.folder, "no trust or trust-sdf model, whose validation labels give the threshold")


def _names_of(folder: Path) -> tuple[str, str | None]:
    """By which hashes a model may name the one in `folder` as its input: a packed one goes by its origin's, too."""
    return sha256(folder / MANIFEST), read_manifest(folder, "model").extra.get(PACKED_FROM)
