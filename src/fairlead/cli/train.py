"""`fairlead train dynamics|distilled|full-dynamics|trust|recovery SCENARIO --data DIR --out DIR`."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from fairlead.cli.output import show
from fairlead.core.cores import cores

if TYPE_CHECKING:
    from fairlead.reproduce.presets import Preset

NEEDS = {"distilled": ("dynamics",), "trust": ("dynamics",), "recovery": ("dynamics", "trust")}
"""The other models that each model is trained on."""
SETTINGS = {"dynamics": ("network",), "full-dynamics": ("grid",), "trust": ("network", "grid", "delta")}
"""What can be chosen of each."""


@dataclass(frozen=True)
class Command:
    """Train one model. Interrupt it at will: the same command goes on, on a processor to the same weights."""

    model: Annotated[Literal["dynamics", "distilled", "full-dynamics", "trust", "recovery"], tyro.conf.Positional]
    """What to train."""
    scenario: Annotated[str, tyro.conf.Positional]
    """The world, for example `dragging`."""
    data: Path
    """The dataset: phase 1 for dynamics, phase 2 for the others."""
    out: Path
    """Folder of the model."""
    first: int | None = None
    """Learn from the first so many trajectories of the dataset; from all by default."""
    dynamics: Path | None = None
    """Folder of the trained dynamics (distilled, trust, recovery)."""
    trust: Path | None = None
    """Folder of the trained classifier (recovery)."""
    network: str | None = None
    """dynamics: chain, or mlp (the paper's layers). trust: sdf or voxel (the paper's)."""
    grid: Literal["coarse", "paper"] | None = None
    """Voxels of a voxel classifier or of full dynamics; the preset's by default."""
    delta: float | None = None
    """trust: largest error [m] of a reliable prediction; the preset's by default, and where it has none the dynamics'
    own."""
    preset: str = "desk"
    """Whose settings of training: smoke, desk or paper."""
    seed: int = 0
    """Of every random stream."""
    threads: int = field(default_factory=cores)
    """Of training; another number rounds differently."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> None:
        """Train, and print the metrics."""
        from fairlead.core.artifacts import read_json
        from fairlead.learning.registry import use_threads
        from fairlead.reproduce import stages
        from fairlead.reproduce.presets import preset
        from fairlead.scenarios.registry import scenario

        self._check()
        use_threads(self.threads)
        world, data = scenario(self.scenario), stages.Part(self.data, self.first)
        needed = [getattr(self, name) for name in NEEDS.get(self.model, ())]
        train = getattr(stages, self.model.replace("-", "_"))
        train(world, data, *needed, self._settings(preset(world, self.preset)), self.out, self.seed)
        show(read_json(self.out / "metrics.json"), self.json)

    def _settings(self, sizes: Preset) -> Any:
        """The preset's settings of this model, changed by what is chosen here."""
        from fairlead.core.artifacts import read_json
        from fairlead.learning.distilled import DistilledConfig
        from fairlead.learning.trust_network import COARSE_GRID, COARSE_GRID_3D, PAPER_GRID, PAPER_GRID_3D

        if self.model == "distilled":
            return sizes.distilled or DistilledConfig()
        if self.model == "recovery" and self.trust:
            sdf = read_json(self.trust / "config.json").get("network") == "sdf"
            return sizes.recovery_sdf if sdf else sizes.recovery
        settings: Any = {
            "dynamics": sizes.dynamics,
            "full-dynamics": sizes.full_dynamics,
            "trust": sizes.trust if self.network == "voxel" else sizes.trust_sdf,
        }[self.model]
        if (self.model, self.network) == ("dynamics", "mlp"):
            settings = replace(settings, hidden=1024, planar=False)
        grids = {
            "coarse": COARSE_GRID if sizes.trust.planar else COARSE_GRID_3D,
            "paper": PAPER_GRID if sizes.trust.planar else PAPER_GRID_3D,
        }
        grid = grids[self.grid] if self.grid else None
        chosen = {"network": self.network, "grid": grid, "delta_m": self.delta}
        return replace(settings, **{name: value for name, value in chosen.items() if value is not None})

    def _check(self) -> None:
        """Refuse what is missing, and what would mean nothing."""
        from fairlead.core.errors import FairleadError

        needed, chosen = NEEDS.get(self.model, ()), SETTINGS.get(self.model, ())
        for name in ("dynamics", "trust", "network", "grid", "delta"):
            given = getattr(self, name) is not None
            if name in needed and not given:
                raise FairleadError(f"train {self.model} needs --{name} DIR, the folder of the trained {name}")
            if given and name not in (*needed, *chosen):
                raise FairleadError(f"--{name} means nothing to train {self.model}")
        if self.model == "trust" and self.grid and self.network != "voxel":
            raise FairleadError("--grid means nothing to train trust without --network voxel")
