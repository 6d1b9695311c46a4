"""Where everything on the page comes from."""

from __future__ import annotations

from fairlead.core.artifacts import MANIFEST, read_json, sha256
from fairlead.report.sources import Sources
from fairlead.report.tables import Table


def provenance_table(sources: Sources) -> Table:
    """Seed, revision, hash, time, hardware and versions of every artifact, from their manifests."""
    folders = [*(t.folder for t in sources.trials), *(m.folder for m in sources.models), *sources.datasets]
    found = [(folder, read_json(folder / MANIFEST)) for folder in [*folders, *sources.evidence, *sources.sensitivity]]
    rows = [
        (
            folder.name,
            manifest["kind"],
            str(manifest["seed"]),
            manifest["git"],
            sha256(folder / MANIFEST)[:12],
            f"{manifest['wall_s']:.0f}",
            f"{manifest['hardware']['cores']} x {manifest['hardware']['machine']}",
            ", ".join(
                f"{k} {v}" for k, v in manifest["versions"].items() if k in ("python", "mujoco", "torch", "ompl")
            ),
        )
        for folder, manifest in found
    ]
    columns = ("artifact", "kind", "seed", "revision", "manifest SHA-256", "wall [s]", "cores", "versions")
    return Table("Artifacts", columns, tuple(rows))
