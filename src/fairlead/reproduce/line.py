"""The whole line in one folder: data, models, trials, report. Run again, it goes on where it stopped."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from fairlead.data.collect import CollectConfig, collect
from fairlead.learning.registry import use_threads
from fairlead.report.page import write_report
from fairlead.reproduce import stages
from fairlead.reproduce.cameras import camera
from fairlead.reproduce.presets import Preset
from fairlead.reproduce.scene_sets import scene_sets
from fairlead.reproduce.sensitivity import sensitivity
from fairlead.reproduce.trials import Bar, try_sets
from fairlead.scenarios.scenario import Scenario


def reproduce(
    scenario: Scenario,
    preset: Preset,
    out: Path,
    seed: int,
    threads: int,
    bar: Bar,
    tell: Callable[[str], None] = lambda line: None,
) -> Path:
    """Collect, train, try and report; the path of the page.

    Args:
        scenario: the world.
        preset: how large.
        out: folder of everything.
        seed: of data and training; the trials' are the preset's.
        threads: of the simulator and of training, and the number of processes that run trials.
        bar: opens a progress bar.
        tell: gets a line about each set of scenes that is left out because it is not here.

    Raises:
        FairleadError: a folder in `out` holds something that this line did not make.
    """
    use_threads(threads)
    sets = scene_sets(scenario, preset.sets, out, seed, tell)
    data, models = _data(scenario, preset, out, seed, threads, bar), out / "models"
    _models(scenario, preset, data, models, seed)
    try_sets(scenario, preset, models, sets, out / "trials", threads, bar)
    if preset.sensitivity:
        sensitivity(scenario, preset.sensitivity, preset.trust_sdf, stages.Part(data[1], preset.phase2),
                    models / "dynamics", out / "sensitivity", seed, threads, bar)  # fmt: skip
    return write_report([out], out / "report", videos=preset.videos, cameras=camera)


def recorded(scenario: Scenario, config: CollectConfig, folder: Path, threads: int, bar: Bar) -> None:
    """Record a dataset, or what is missing of it."""
    total = config.trajectories * config.resolved(scenario)["steps"]
    with bar(f"{scenario.name} {folder.name}", total, "transitions") as advance:
        collect(scenario, config, folder, threads, advance)


def _data(scenario: Scenario, preset: Preset, out: Path, seed: int, threads: int, bar: Bar) -> tuple[Path, Path]:
    """Record both phases. Phase 2 is long enough for the full dynamics; the rest of the line learns from its start."""
    wanted = {
        "phase1": CollectConfig(1, preset.phase1, seed, lanes=preset.lanes),
        "phase2": CollectConfig(2, max(preset.phase2, preset.full), seed, lanes=preset.lanes, steps=preset.steps2,
                                obstacles_every=preset.obstacles_every),
    }  # fmt: skip
    for name, config in wanted.items():
        recorded(scenario, config, out / "data" / name, threads, bar)
    return out / "data" / "phase1", out / "data" / "phase2"


def _models(scenario: Scenario, preset: Preset, data: tuple[Path, Path], models: Path, seed: int) -> None:
    """Train every model, each on the one before it."""
    dynamics, phase2 = models / "dynamics", stages.Part(data[1], preset.phase2)
    stages.dynamics(scenario, data[0], preset.dynamics, dynamics, seed)
    if preset.distilled:
        stages.distilled(scenario, phase2, dynamics, preset.distilled, models / "distilled", seed)
    of = (("", preset.trust, preset.recovery), ("-sdf", preset.trust_sdf, preset.recovery_sdf))
    for suffix, config, recovery in of:
        trust = models / f"trust{suffix}"
        stages.trust(scenario, phase2, dynamics, config, trust, seed)
        stages.recovery(scenario, phase2, dynamics, trust, recovery, models / f"recovery{suffix}", seed)
    among = stages.Part(data[1], preset.full)
    stages.full_dynamics(scenario, among, preset.full_dynamics, models / "full-dynamics", seed)
    stages.evidence(scenario, phase2, dynamics, models / "trust", models.parent / "evidence", seed)
