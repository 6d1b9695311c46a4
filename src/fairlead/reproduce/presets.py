"""How large the line is: `smoke` for tests, `desk` for half an hour, `paper` for the paper's data sizes.

`evidence` tries the models of `paper` in every way; in the same folder it goes on where `paper` ended. The voxel grids
are coarser than the paper's, which take hours on a CPU (`fairlead train --grid paper`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from fairlead.core.budget import Budget
from fairlead.core.errors import UnknownNameError
from fairlead.evaluation.planners import BEST, RELAXED, SHORT
from fairlead.learning.distilled import DistilledConfig
from fairlead.learning.dynamics import DynamicsConfig
from fairlead.learning.fit import Stage
from fairlead.learning.full_dynamics import FullDynamicsConfig
from fairlead.learning.recovery import RecoveryConfig
from fairlead.learning.trust_network import COARSE_GRID_3D, TrustConfig
from fairlead.scenarios.scenario import Scenario


@dataclass(frozen=True)
class SensitivityConfig:
    """Threshold sensitivity (paper, Fig. S2).

    Args:
        deltas_m: what counts as a reliable prediction [m], one classifier each.
        scenes: how many random ones, drawn for this alone.
        budget: of each trial.
    """

    deltas_m: tuple[float, ...] = (0.025, 0.035, 0.045, 0.055, 0.065, 0.075, 0.085, 0.095, 0.105,
                                   0.125, 0.145, 0.165, 0.185, 0.205)  # fmt: skip
    scenes: int = 50
    budget: Budget = field(default_factory=lambda: Budget(seconds=60))


@dataclass(frozen=True)
class Preset:
    """Sizes and settings of every stage.

    Args:
        phase1, phase2: trajectories recorded for the dynamics, and for trust and recovery.
        full: trajectories of phase 2 that the full dynamics learn from, mostly the same and more: as many transitions
            as both phases have together, but for `smoke`.
        steps2: actions in a trajectory of phase 2; 0 for the paper's.
        dynamics, full_dynamics, trust, trust_sdf, recovery, recovery_sdf: of the models.
        methods: what is tried, the first compared with the others.
        budget: of each trial.
        planner: of every method on the sets of scenes. Tasks and other deltas are tried with the paper's, "rrt".
        lanes: trajectories that are recorded side by side; many keep many cores busy.
        obstacles_every: in phase 2 obstacles move after so many trajectories of a lane; the paper's is 8.
        sets: of scenes that are tried, by their names in `scene_sets.SETS`; the first so many of each, None for all.
        seeds: of the trials.
        both_protocols: whether methods that were stuck and have no recovery are tried under the protocol `paper` too.
            For all others the two protocols are the same.
        counted: budget of further trials, on the first set with the first seed, that do not depend on the clock:
            several planning attempts.
        improved: methods that are tried on each set with a better planner too.
        improved_planner: its name.
        improved_budget: of each of these trials.
        distilled: the dynamics are distilled, and these trials plan with that; None for the ensemble.
        improved_seeds: of these trials.
        sensitivity: trust at other deltas (Fig. S2); None for without.
        traced: traces are kept of the first so many scenes of each set, for the report's videos.
        videos: whether the report has them.
    """

    phase1: int
    phase2: int
    full: int
    dynamics: DynamicsConfig
    full_dynamics: FullDynamicsConfig
    trust: TrustConfig
    trust_sdf: TrustConfig
    recovery: RecoveryConfig
    recovery_sdf: RecoveryConfig
    methods: tuple[str, ...]
    budget: Budget = field(default_factory=lambda: Budget(seconds=60))
    planner: str = SHORT
    steps2: int = 0
    lanes: int = 64
    obstacles_every: int = 8
    sets: Mapping[str, int | None] = field(default_factory=lambda: {"benchmark": None})
    seeds: tuple[int, ...] = (0,)
    both_protocols: bool = False
    counted: Budget | None = None
    improved: tuple[str, ...] = ()
    improved_planner: str = RELAXED
    improved_budget: Budget = field(default_factory=lambda: Budget(seconds=60))
    distilled: DistilledConfig | None = None
    improved_seeds: tuple[int, ...] = (0,)
    sensitivity: SensitivityConfig | None = None
    traced: int = 3
    videos: bool = True


LEARNED = ("trust", "trust+recovery", "trust+random-recovery", "trust-sdf", "trust-sdf+recovery",
           "accept-all", "full-dynamics", "collision-check", "spread-threshold")  # fmt: skip
_SOME: Mapping[str, int | None] = {"benchmark": 16, "hard": 16}

_SMOKE = Preset(
    phase1=32, phase2=32, full=16, steps2=8,
    dynamics=DynamicsConfig(hidden=32, blocks=1, stages=(Stage(4, 64), Stage(2, 64, 3e-4, 4))),
    full_dynamics=FullDynamicsConfig(hidden=32, stages=(Stage(1, 64),)),
    trust=TrustConfig("voxel", hidden=16, limit=200, stages=(Stage(1, 32),)),
    trust_sdf=TrustConfig("sdf", hidden=8, limit=1000, stages=(Stage(2, 128),)),
    recovery=RecoveryConfig(samples=8, hidden=16, limit=40, stages=(Stage(1, 32),)),
    recovery_sdf=RecoveryConfig(samples=8, limit=40, discount=0.8, stages=(Stage(2, 32),)),
    methods=LEARNED, budget=Budget(extensions=300), sets={"benchmark": 1}, traced=1, videos=False,
    distilled=DistilledConfig(samples=512, hidden=8, stages=(Stage(1, 64, 5e-4),)),
)  # fmt: skip

# Obstacles that move every 8 trajectories, as in the paper, show a classifier so few arrangements of a desk's data that
# it learns them by heart.
_DESK = Preset(
    phase1=1536, phase2=320, full=627,
    dynamics=DynamicsConfig(stages=(Stage(40, 128, 2e-3), Stage(3, 128, 5e-4, 4))),
    full_dynamics=FullDynamicsConfig(stages=(Stage(6, 64), Stage(1, 64, 3e-4, 4))),
    trust=TrustConfig("voxel", hidden=128, limit=12_000, stages=(Stage(4, 64),)),
    trust_sdf=TrustConfig("sdf", limit=100_000, stages=(Stage(4, 256),)),
    recovery=RecoveryConfig(limit=8000),
    recovery_sdf=RecoveryConfig(limit=8000, discount=0.8, stages=(Stage(16, 128),)),
    methods=LEARNED, obstacles_every=2, sets=_SOME,
)  # fmt: skip

# With all the data the dynamics' own delta is 36 mm, and a classifier of it refuses too much where it is tight:
# trust_sdf takes the paper's 65 mm (docs/adr/0013), trust the paper's rule.
_PAPER = Preset(
    phase1=6144, phase2=2048, full=3277,
    dynamics=DynamicsConfig(stages=(Stage(40, 128, 2e-3), Stage(10, 128, 5e-4, 4))),
    full_dynamics=FullDynamicsConfig(stages=(Stage(8, 64), Stage(1, 64, 3e-4, 4))),
    trust=TrustConfig("voxel", hidden=128, limit=50_000, stages=(Stage(4, 64),)),
    trust_sdf=TrustConfig("sdf", delta_m=0.065, limit=400_000, stages=(Stage(6, 512),)),
    recovery=RecoveryConfig(limit=20_000),
    recovery_sdf=RecoveryConfig(limit=40_000, discount=0.8, stages=(Stage(16, 128),)),
    methods=LEARNED, budget=Budget(seconds=180), planner="rrt", obstacles_every=2,
    sets={"benchmark": 20, "hard": 20, "authors": None},
    improved=("trust-sdf", "accept-all", "full-dynamics", "collision-check"),
    improved_planner=BEST, distilled=DistilledConfig(),
)  # fmt: skip

_DUAL_SMOKE = Preset(
    phase1=16, phase2=16, full=16, steps2=4,
    dynamics=DynamicsConfig(hidden=32, blocks=1, planar=False, stages=(Stage(4, 64), Stage(2, 64, 3e-4, 4))),
    full_dynamics=FullDynamicsConfig(hidden=32, planar=False, grid=COARSE_GRID_3D, stages=(Stage(1, 32),)),
    trust=TrustConfig("voxel", planar=False, delta_m=0.1, hidden=16, grid=COARSE_GRID_3D, limit=64,
                      stages=(Stage(1, 32),)),
    trust_sdf=TrustConfig("sdf", planar=False, delta_m=0.1, hidden=8, limit=500, stages=(Stage(2, 64),)),
    recovery=RecoveryConfig(samples=4, hidden=16, limit=16, stages=(Stage(1, 32),)),
    recovery_sdf=RecoveryConfig(samples=4, limit=16, discount=0.8, stages=(Stage(2, 32),)),
    methods=LEARNED, budget=Budget(extensions=200), sets={"benchmark": 1}, traced=1, videos=False,
)  # fmt: skip

# The dynamics' own delta is as small as the creep of a draped rope, 9 mm with all the data: 25 mm is the paper's.
_DUAL_DESK = Preset(
    phase1=1024, phase2=512, full=1024,
    dynamics=DynamicsConfig(planar=False, stages=(Stage(40, 128, 2e-3), Stage(4, 128, 5e-4, 4))),
    full_dynamics=FullDynamicsConfig(planar=False, grid=COARSE_GRID_3D, stages=(Stage(8, 64),)),
    trust=TrustConfig("voxel", planar=False, delta_m=0.025, hidden=128, grid=COARSE_GRID_3D, limit=25_000,
                      stages=(Stage(3, 64),)),
    trust_sdf=TrustConfig("sdf", planar=False, delta_m=0.025, limit=100_000, stages=(Stage(6, 256),)),
    recovery=RecoveryConfig(limit=1500),
    recovery_sdf=RecoveryConfig(limit=10_000, discount=0.8, stages=(Stage(16, 128),)),
    methods=("trust+recovery", "trust+random-recovery", "trust", "trust-sdf+recovery", "accept-all", "accept-all+arms",
             "full-dynamics", "collision-check", "spread-threshold"),
    obstacles_every=2, sets={"benchmark": 10, "hard": 6},
)  # fmt: skip

_DUAL_PAPER = Preset(
    phase1=2048, phase2=5996, full=7020,
    dynamics=DynamicsConfig(planar=False, stages=(Stage(80, 128, 2e-3), Stage(10, 128, 5e-4, 4))),
    full_dynamics=FullDynamicsConfig(planar=False, grid=COARSE_GRID_3D, stages=(Stage(6, 64), Stage(1, 64, 3e-4, 4))),
    trust=TrustConfig("voxel", planar=False, delta_m=0.025, hidden=128, grid=COARSE_GRID_3D, limit=100_000,
                      stages=(Stage(2, 64),)),
    trust_sdf=TrustConfig("sdf", planar=False, delta_m=0.025, limit=400_000, stages=(Stage(6, 512),)),
    recovery=RecoveryConfig(limit=5000),
    recovery_sdf=RecoveryConfig(limit=40_000, discount=0.8, stages=(Stage(16, 128),)),
    methods=_DUAL_DESK.methods, budget=Budget(seconds=180), planner="rrt", lanes=256, obstacles_every=2,
    sets={"benchmark": 20, "hard": 10, "authors": None},
    improved=("trust-sdf+recovery", "trust-sdf+planned-recovery", "trust-sdf+doubted-recovery",
              "trust-sdf+random-recovery", "accept-all+arms", "full-dynamics+arms", "collision-check",
              "collision-check+random-recovery"),
    distilled=DistilledConfig(),
)  # fmt: skip


def _in_every_way(sizes: Preset) -> Preset:
    """The same data and models, and every trial that the paper's tables and figures and ours need."""
    return replace(sizes, sets={"benchmark": None, "hard": None, "authors": None}, improved_seeds=(0, 1, 2),
                   both_protocols=True, counted=Budget(extensions=60_000), sensitivity=SensitivityConfig())  # fmt: skip


PRESETS: dict[str, dict[str, Preset]] = {
    "dragging": {"smoke": _SMOKE, "desk": _DESK, "paper": _PAPER, "evidence": _in_every_way(_PAPER)},
    "dual_arm": {
        "smoke": _DUAL_SMOKE,
        "desk": _DUAL_DESK,
        "paper": _DUAL_PAPER,
        "evidence": _in_every_way(_DUAL_PAPER),
    },
}


def preset(scenario: Scenario, name: str) -> Preset:
    """The preset of that name for a scenario; UnknownNameError otherwise.

    A task takes the sizes of its base; a scenario that has none takes those of the paper's scenario that moves as it
    does: in the plane, or in space.
    """
    alike = "dragging" if scenario.sampler.planar else "dual_arm"
    sizes = PRESETS.get(scenario.base or scenario.name, PRESETS[alike])
    if name not in sizes:
        raise UnknownNameError("preset", name, sizes)
    return sizes[name]
