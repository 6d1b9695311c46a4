"""Which scenes can be solved: those that somebody has."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fairlead.core.artifacts import MANIFEST, read_json, read_jsonl, read_manifest, sha256, verify_files
from fairlead.core.errors import ArtifactError, FairleadError
from fairlead.evaluation.trials import TRIALS
from fairlead.scenarios.scenario import Scenario
from fairlead.scenarios.scene_files import Scene


def solved_scenes(scenario: Scenario, path: Path, trials: Sequence[Path], count: int) -> tuple[list[Scene], str]:
    """The first `count` scenes of a file that a trial in one of the folders solved, and in words where they come from.

    Raises:
        FairleadError: fewer were solved, or a folder holds no finished trials of that very file.
    """
    solved: set[str] = set()
    by = []
    for folder in trials:
        manifest = read_manifest(folder, "trials")
        verify_files(folder, manifest)
        if manifest.inputs["scenes"] != sha256(path):
            raise ArtifactError(folder, f"trials of other scenes than those of {path}")
        rows = [row for row in read_jsonl(folder / TRIALS) if row["success"]]
        solved |= {row["scene"] for row in rows}
        methods = ", ".join(sorted({row["method"] for row in rows}))
        by.append(f"{methods} ({folder.name}, manifest {sha256(folder / MANIFEST)[:12]})")
    scenes = scenario.scenes(path).scenes
    kept = [i for i, scene in enumerate(scenes) if scene.name in solved][:count]
    if not 0 < len(kept) == count:
        raise FairleadError(f"count {count}: {len(solved)} of the {len(scenes)} scenes of {path} were solved")
    left = kept[-1] + 1 - count
    source = f"{read_json(path).get('source', path.name)}: the first {count} of {len(scenes)} that were solved by "
    return [
        scenes[i] for i in kept
    ], f"{source}{'; '.join(by)}; {left} before the last of them were not, or were not tried"
