"""The table of methods: each a row of dynamics, check and recovery (paper, "Experiments"), and how to build one."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, TypeVar, final

from fairlead.core import plugins
from fairlead.core.answers import expect_kind
from fairlead.core.artifacts import MANIFEST
from fairlead.core.errors import ArtifactError, UnknownNameError
from fairlead.core.roles import Dynamics, RecoveryPolicy, TransitionCheck
from fairlead.evaluation.models import Models
from fairlead.learning.registry import load_check, load_distilled, load_dynamics, load_full_dynamics, load_recovery
from fairlead.learning.trust import LearnedCheck
from fairlead.planning.checks import AcceptAll, CollisionCheck, SpreadThreshold
from fairlead.planning.memory import DoubtfulRecovery
from fairlead.planning.problem import Problem
from fairlead.planning.recovery import NoRecovery, PlannedRecovery, RandomRecovery
from fairlead.planning.rrt import BatchedRRT
from fairlead.scenarios.arms_check import recovery_within_reach, within_reach
from fairlead.scenarios.oracle import SimulatorDynamics
from fairlead.scenarios.scenario import Scenario
from fairlead.scenarios.scene_files import Scene

T = TypeVar("T")

CONTACT_GIVES_M = 0.003
"""A rope that rests on something is closer to it than its radius, for contacts give way (docs/adr/0018)."""


@dataclass(frozen=True)
class Method:
    """One row. The names are keys of `DYNAMICS` (or "simulator"), `CHECKS` and `RECOVERIES` (or "planned", "doubted"),
    or those of installed ones.

    budget_scale multiplies the budget; only the oracle, a bound and not a rival, has more than the others.
    """

    dynamics: str
    check: str
    recovery: str
    sentence: str
    budget_scale: float = 1.0


METHODS: dict[str, Method] = {
    "trust": Method("learned", "trust", "none", "The paper's classifier, with what arms can do where there are any."),
    "trust+recovery": Method("learned", "trust", "learned", "The paper's complete method: `trust`, with recovery."),
    "trust+random-recovery": Method("learned", "trust", "random", "The classifier; stuck, a random action."),
    "trust-sdf": Method("learned", "trust-sdf", "none", "A small classifier on signed distances."),
    "trust-sdf+recovery": Method("learned", "trust-sdf", "learned-sdf", "The small classifier, with recovery."),
    "trust-sdf+random-recovery": Method(
        "learned", "trust-sdf", "random", "The small classifier; stuck, a random action."
    ),
    "trust-sdf+planned-recovery": Method(
        "learned",
        "trust-sdf",
        "planned",
        "Not of the paper: the small classifier; stuck, a plan of the collision check, while it goes as predicted.",
    ),
    "trust-sdf+doubted-recovery": Method(
        "learned",
        "trust-sdf",
        "doubted",
        "Not of the paper: learned recovery; the more actions were cut short hereabouts, the rather planned.",
    ),
    "accept-all": Method("learned", "accept-all", "none", "The same dynamics, trusted everywhere."),
    "accept-all+arms": Method("learned", "arms", "none", "Trusted everywhere that the arms can reach."),
    "full-dynamics": Method("full", "accept-all", "none", "Dynamics that learn the obstacles too, no check."),
    "full-dynamics+arms": Method("full", "arms", "none", "The same, trusted everywhere that the arms can reach."),
    "collision-check": Method("learned", "collision", "none", "A collision check made by hand."),
    "collision-check+random-recovery": Method(
        "learned", "collision", "random", "The check made by hand; stuck, a random action."
    ),
    "spread-threshold": Method("learned", "spread", "none", "Trust where the ensemble agrees."),
    "spread-threshold+arms": Method(
        "learned", "spread+arms", "none", "Trust where the ensemble agrees and the arms can reach."
    ),
    "oracle": Method("simulator", "accept-all", "none", "Plans with the simulator itself: what is solvable.", 5.0),
}
"""In the order to report; without another word the first that was tried is compared with each of the others."""


DYNAMICS: dict[str, Callable[[Models], Dynamics]] = {
    "learned": lambda models: _learned(models),
    "full": lambda models: load_full_dynamics(models.folder_of("full-dynamics"), models.scenario.kin),
}
"""Besides "simulator", which is built anew for each scene. Others come by entry points in `fairlead.dynamics`."""


def _learned(models: Models) -> Dynamics:
    if models.distilled:
        folder = models.folder / "distilled"
        if not (folder / MANIFEST).exists():
            raise ArtifactError(
                folder, "no finished model; leave out --distilled, or `fairlead train distilled` into it"
            )
        return load_distilled(models.folder_of("distilled"), models.scenario.kin)
    return load_dynamics(models.folder_of("dynamics"), models.scenario.kin)


CHECKS: dict[str, Callable[[Models], TransitionCheck]] = {
    "accept-all": lambda models: AcceptAll(),
    "arms": lambda models: within_reach(AcceptAll(), models.scenario),
    "collision": lambda models: within_reach(_collision(models.scenario), models.scenario),
    "spread": lambda models: SpreadThreshold(models.spread_threshold_m),
    "spread+arms": lambda models: within_reach(SpreadThreshold(models.spread_threshold_m), models.scenario),
    "trust": lambda models: _trust(models, "trust"),
    "trust-sdf": lambda models: _trust(models, "trust-sdf"),
}
"""Others come by entry points in `fairlead.checks`: a function of the models.

The classifiers and the collision check know what the scenario's arms can do. So do "arms" and "spread+arms": they tell
what knowing the arms is worth without trust. The others know no geometry at all.
"""

RECOVERIES: dict[str, Callable[[Models], RecoveryPolicy]] = {
    "none": lambda models: NoRecovery(),
    "random": lambda models: recovery_within_reach(RandomRecovery(models.sampler), models.scenario),
    "learned": lambda models: _recovery(models, "recovery", models.remember),
    "learned-sdf": lambda models: _recovery(models, "recovery-sdf", models.remember),
    "learned-sdf, undoubted": lambda models: _recovery(models, "recovery-sdf", doubt=False),
}
"""Others come by entry points in `fairlead.recoveries`."""

PARTS: dict[str, tuple[dict[str, Any], type]] = {
    "dynamics": (DYNAMICS, Dynamics),
    "check": (CHECKS, TransitionCheck),
    "recovery": (RECOVERIES, RecoveryPolicy),
}
"""What a method is made of: the table and the role of each kind of part."""


def _collision(scenario: Scenario) -> CollisionCheck:
    return CollisionCheck(scenario.layout, max(0.0, scenario.rope_radius - CONTACT_GIVES_M))


def _trust(models: Models, name: str) -> TransitionCheck:
    return with_arms(load_check(models.folder_of(name), models.scenario.kin), models.scenario)


def with_arms(check: LearnedCheck, scenario: Scenario) -> TransitionCheck:
    """A classifier as planning asks it: with what the arms can do, unless it has learned that itself."""
    return within_reach(check, scenario) if check.network.config.reach_known else check


def _recovery(models: Models, name: str, doubt: bool) -> RecoveryPolicy:
    policy: RecoveryPolicy = load_recovery(models.folder_of(name), models.scenario.kin, models.sampler)
    if doubt:
        policy = DoubtfulRecovery(policy, RandomRecovery(models.sampler), models.tried)
    return recovery_within_reach(policy, models.scenario)


def find_method(name: str) -> Method:
    """The row of that name; the name of an installed check is the learned dynamics with that check, no recovery.

    Raises:
        UnknownNameError: neither a row nor an installed method or check.
        FairleadError: what is installed is no `Method`.
    """
    if name in plugins.names("method", METHODS):
        found: Method = plugins.find("method", name, METHODS)
        expect_kind(f"method '{name}'", found, Method)
        return found
    if name in method_names():
        return Method("learned", name, "none", f"The learned dynamics, checked by {name}.")
    raise UnknownNameError("method", name, method_names())


def method_names() -> list[str]:
    """The rows of the table, then the installed methods and checks."""
    installed = (*plugins.names("method", {}), *plugins.names("check", {}))
    return [*METHODS, *dict.fromkeys(name for name in installed if name not in {*METHODS, *CHECKS})]


def in_order(names: Iterable[str]) -> list[str]:
    """Methods in the order of the table; those that are installed follow, by name."""
    table = list(METHODS)
    return sorted(set(names), key=lambda name: (table.index(name) if name in METHODS else len(table), name))


@final
class Parts:
    """Builds the parts of methods, and keeps those that do not depend on the scene."""

    def __init__(self, models: Models) -> None:
        self._models = models
        self._dynamics: dict[str, Dynamics] = {}
        self._checks: dict[str, TransitionCheck] = {}
        self._recoveries: dict[str, RecoveryPolicy] = {}

    def build(self, method: Method, scene: Scene) -> tuple[Dynamics, TransitionCheck, RecoveryPolicy]:
        """The dynamics, check and recovery of a method in a scene.

        Raises:
            ArtifactError: a model that the method needs is missing, damaged or of another scenario.
        """
        models = self._models
        if method.dynamics == "simulator":
            dynamics: Dynamics = SimulatorDynamics(models.scenario, scene.obstacles)
        else:
            dynamics = _once(self._dynamics, method.dynamics, lambda: self._made("dynamics", method.dynamics))
        if method.recovery in ("planned", "doubted"):
            environment = models.scenario.environment(scene.obstacles)
            problem = Problem(environment, scene.goal, dynamics, self._check("collision"), models.sampler)
            recovery: RecoveryPolicy = PlannedRecovery(BatchedRRT(), problem, self._recovery("random"))
            if method.recovery == "doubted":
                recovery = DoubtfulRecovery(self._recovery("learned-sdf, undoubted"), recovery, models.tried)
        else:
            recovery = self._recovery(method.recovery)
        return dynamics, self._check(method.check), recovery

    def _recovery(self, name: str) -> RecoveryPolicy:
        return _once(self._recoveries, name, lambda: self._made("recovery", name))

    def _check(self, name: str) -> TransitionCheck:
        return _once(self._checks, name, lambda: self._made("check", name))

    def _made(self, kind: str, name: str) -> Any:
        """A part of that kind; with which version of an installed one it was made is kept beside the models' hashes."""
        table, role = PARTS[kind]
        made = plugins.find(kind, name, table)(self._models)
        expect_kind(f"{kind} '{name}'", made, role)
        if digest := plugins.fingerprint(kind, name, table):
            self._models.hashes[f"{kind} {name}"] = digest
        return made


def _once(kept: dict[str, T], name: str, make: Callable[[], T]) -> T:
    if name not in kept:
        kept[name] = make()
    return kept[name]
