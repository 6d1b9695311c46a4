"""The whole line in one folder: data, models, trials, report. Run again, it goes on where it stopped."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from pathlib import Path

from fairlead.core.errors import ArtifactError
from fairlead.data.collect import CollectConfig, collect
from fairlead.evaluation.bench import TrialsConfig
from fairlead.evaluation.shipped import benchmark_scenes
from fairlead.evaluation.trials import Trials
from fairlead.learning.registry import use_threads
from fairlead.report.page import write_report
from fairlead.reproduce import stages
from fairlead.reproduce.cameras import camera
from fairlead.reproduce.presets import Preset
from fairlead.scenarios.generate import generate
from fairlead.scenarios.scenario import Scenario
from fairlead.scenarios.scene_files import write_scenes

Bar = Callable[[str, int, str], AbstractContextManager[Callable[[int], None]]]
"""Opens a progress bar with a title, a total and a unit; yields a function that advances it."""

SCENES = 50
"""Drawn for a scenario whose benchmark does not come with the package."""


def reproduce(scenario: Scenario, preset: Preset, out: Path, seed: int, threads: int, bar: Bar) -> Path:
    """Collect, train, try and report; the path of the page.

    Args:
        scenario: the world.
        preset: how large.
        out: folder of everything.
        seed: everything random derives from it.
        threads: of the simulator and of training, and the number of processes that run trials.
        bar: opens a progress bar.

    Raises:
        FairleadError: a folder in `out` holds something that this line did not make.
    """
    use_threads(threads)
    data, models = _data(scenario, preset, out, seed, threads, bar), out / "models"
    _models(scenario, preset, data, models, seed)
    scenes = _scenes(scenario, out, seed)
    config = TrialsConfig(scenario.name, models, scenes, preset.methods, preset.budget, seeds=preset.seeds,
                          limit=preset.scenes, traced=preset.traced, reference=preset.methods[0])  # fmt: skip
    tried(config, out / "trials", threads, bar)
    return write_report([out], out / "report", videos=preset.videos, cameras=camera)


def recorded(scenario: Scenario, config: CollectConfig, folder: Path, threads: int, bar: Bar) -> None:
    """Record a dataset, or what is missing of it."""
    total = config.trajectories * config.resolved(scenario)["steps"]
    with bar(f"{scenario.name} {folder.name}", total, "transitions") as advance:
        collect(scenario, config, folder, threads, advance)


def tried(config: TrialsConfig, out: Path, workers: int, bar: Bar) -> Path:
    """Run the trials that `out` does not hold yet; `out` is returned."""
    trials = Trials(config, out)
    with bar(f"{config.scenario} trials", len(trials.missing), "trials") as advance:
        trials.run(workers, lambda row: advance(1))
    return out


def _scenes(scenario: Scenario, out: Path, seed: int) -> Path:
    """The benchmark scenes; where none come with the package, random ones in `out`."""
    with suppress(ArtifactError):
        return benchmark_scenes(scenario.name)
    path = out / "scenes.json"
    if not path.exists():
        scenes = generate(scenario, "random", SCENES, seed)
        write_scenes(path, scenario.name, scenes, f"fairlead scenes {scenario.name}, random, seed {seed}")
    return path


def _data(scenario: Scenario, preset: Preset, out: Path, seed: int, threads: int, bar: Bar) -> dict[str, Path]:
    """Record the three datasets; the full dynamics have one of their own, as large as the other two together."""
    wanted = {
        "phase1": CollectConfig(1, preset.phase1, seed),
        "phase2": CollectConfig(2, preset.phase2, seed, steps=preset.steps2),
        "full": CollectConfig(2, preset.full, seed + 1, steps=preset.steps2),
    }
    folders = {name: out / "data" / name for name in wanted}
    for name, config in wanted.items():
        recorded(scenario, config, folders[name], threads, bar)
    return folders


def _models(scenario: Scenario, preset: Preset, data: dict[str, Path], models: Path, seed: int) -> None:
    """Train every model, each on the one before it."""
    dynamics, phase2 = models / "dynamics", data["phase2"]
    stages.dynamics(scenario, data["phase1"], preset.dynamics, dynamics, seed)
    for suffix, config in (("", preset.trust), ("-sdf", preset.trust_sdf)):
        trust = models / f"trust{suffix}"
        stages.trust(scenario, phase2, dynamics, config, trust, seed)
        stages.recovery(scenario, phase2, dynamics, trust, preset.recovery, models / f"recovery{suffix}", seed)
    stages.full_dynamics(scenario, data["full"], preset.full_dynamics, models / "full-dynamics", seed)
    stages.evidence(scenario, phase2, dynamics, models / "trust", models.parent / "evidence", seed)
