"""Writing the trace of a trial; `fairlead.core.traces` describes the files and reads them."""

from __future__ import annotations

import io
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, final

import numpy as np

from fairlead.core.artifacts import append_jsonl, write_atomic
from fairlead.core.errors import ArtifactError
from fairlead.core.records import Plan, PlanOutcome, SearchTree
from fairlead.core.traces import EVENTS


class Recorder(ABC):
    """Is told what happens in a trial."""

    @abstractmethod
    def event(self, event: Mapping[str, Any]) -> None:
        """Something happened."""

    @abstractmethod
    def plan(self, event: Mapping[str, Any], plan: Plan) -> None:
        """A plan was made."""


@final
class NoTrace(Recorder):
    """Forgets everything."""

    def event(self, event: Mapping[str, Any]) -> None:
        pass

    def plan(self, event: Mapping[str, Any], plan: Plan) -> None:
        pass


@final
class TraceFolder(Recorder):
    """Writes a trace to a new folder.

    Args:
        folder: where; must not hold a trace.
        about: what to say of the trial, as JSON values.

    Raises:
        ArtifactError: the folder holds a trace already.
    """

    def __init__(self, folder: Path, about: Mapping[str, Any]) -> None:
        if (folder / EVENTS).exists():
            raise ArtifactError(folder, "holds a trace already; remove it or choose another folder")
        self.folder, self.about = folder, dict(about)

    def event(self, event: Mapping[str, Any]) -> None:
        if event["event"] == "start":
            event = {**event, "about": self.about}
        append_jsonl(self.folder / EVENTS, event)

    def plan(self, event: Mapping[str, Any], plan: Plan) -> None:
        name = None
        if plan.outcome is not PlanOutcome.STUCK:
            name = f"plan-{event['index']:04d}.npz"
            write_atomic(self.folder / name, _arrays(plan))
        self.event({**event, "arrays": name})


def _arrays(plan: Plan) -> bytes:
    tree = plan.tree or SearchTree(plan.states, np.arange(-1, len(plan)).clip(0), np.append(1.0, plan.trust))
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        allow_pickle=False,
        states=plan.states.astype(np.float32),
        actions=plan.actions.astype(np.float32),
        trust=plan.trust.astype(np.float32),
        tree_states=tree.states.astype(np.float32),
        tree_parents=tree.parents.astype(np.int32),
        tree_trust=tree.trust.astype(np.float32),
    )
    return buffer.getvalue()
