"""Threshold sensitivity of dragging: the preset `desk`'s classifier at each delta, on the dynamics that come along.

fairlead collect dragging --phase 2 --trajectories 896 --obstacles-every 2 --out data/phase2
python make.py
"""

from contextlib import contextmanager
from pathlib import Path

from fairlead.evaluation.shipped import shipped_models
from fairlead.learning.registry import use_threads
from fairlead.reproduce import stages
from fairlead.reproduce.presets import SensitivityConfig, preset
from fairlead.reproduce.sensitivity import sensitivity
from fairlead.scenarios.registry import scenario


@contextmanager
def bar(*_):
    """No progress bar."""
    yield lambda _: None


if __name__ == "__main__":
    use_threads(1)
    world = scenario("dragging")
    dynamics = Path("models/dynamics")
    stages.reused(shipped_models("dragging") / "dynamics", dynamics)
    data, out = Path("data/phase2"), Path("sensitivity")
    sensitivity(world, SensitivityConfig(), preset(world, "desk").trust_sdf, data, dynamics, out, 0, 1, bar)
