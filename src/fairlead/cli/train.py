"""`fairlead train dynamics|distilled|full-dynamics|trust|recovery SCENARIO --data DIR --out DIR`."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from fairlead.cli.output import show
from fairlead.core.cores import cores

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
    """dynamics: chain or mlp (the paper's). trust: sdf or voxel (the paper's)."""
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
        from fairlead.learning.distilled import DistilledConfig
        from fairlead.learning.registry import use_threads
        from fairlead.learning.trust_network import COARSE_GRID, COARSE_GRID_3D, PAPER_GRID, PAPER_GRID_3D
        from fairlead.reproduce import stages
        from fairlead.reproduce.presets import preset
        from fairlead.scenarios.registry import scenario

        self._check()
        data = stages.Part(self.data, self.first)
        use_threads(self.threads)
        world = scenario(self.scenario)
        sizes = preset(world, self.preset)
        planar = sizes.trust.planar
        grids = {
            "coarse": COARSE_GRID if planar else COARSE_GRID_3D,
            "paper": PAPER_GRID if planar else PAPER_GRID_3D,
        }
        grid = {} if self.grid is None else {"grid": grids[self.grid]}
        delta = {} if self.delta is None else {"delta_m": self.delta}
        if self.model == "dynamics":
            wide = {"network": "mlp", "hidden": 1024, "planar": False} if self.network == "mlp" else {}
            other = {} if self.network in (None, "mlp") else {"network": self.network}
            config = replace(sizes.dynamics, **wide, **other)
            stages.dynamics(world, data, config, self.out, self.seed)
        elif self.model == "distilled" and self.dynamics:
            stages.distilled(world, data, self.dynamics, sizes.distilled or DistilledConfig(), self.out, self.seed)
        elif self.model == "full-dynamics":
            stages.full_dynamics(world, data, replace(sizes.full_dynamics, **grid), self.out, self.seed)
        elif self.model == "trust" and self.dynamics:
            base = sizes.trust if self.network == "voxel" else sizes.trust_sdf
            config = replace(base, **grid, network=self.network or base.network, **delta)
            stages.trust(world, data, self.dynamics, config, self.out, self.seed)
        elif self.dynamics and self.trust:
            sdf = read_json(self.trust / "config.json").get("network") == "sdf"
            config = sizes.recovery_sdf if sdf else sizes.recovery
            stages.recovery(world, data, self.dynamics, self.trust, config, self.out, self.seed)
        show(read_json(self.out / "metrics.json"), self.json)

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
