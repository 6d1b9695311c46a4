"""The trace of a trial: what was planned and what happened, readable whatever ended the trial.

A folder with `events.jsonl`, one object an event, appended and synced as it happens, and one `plan-NNNN.npz` of float32
arrays for each plan, written before the event that names it. Events, in order:

    start     about (whatever the caller says of the trial: scene, method, seed), layout, state, error_m
    plan      index, outcome, steps, extensions, nodes, invalid, at_s, arrays (the file's name; null where stuck)
    action    plan, recovery (true or false), action, outcome, seconds, at_s, state, error_m (both after the action)
    end       outcome and the rest of the trial's result

`at_s` [s] is the time of the trial: planning wall time plus simulated execution time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from jaxtyping import Float

from fairlead.core.artifacts import read_jsonl
from fairlead.core.errors import ArtifactError
from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome, PlanOutcome, SearchTree, TrialOutcome

EVENTS = "events.jsonl"


@dataclass(frozen=True)
class TracedPlan:
    """One planning attempt. `at_s` is when it was ready [s]; a stuck one has no actions and the start as its tree."""

    index: int
    outcome: PlanOutcome
    at_s: float
    extensions: int
    states: Float[np.ndarray, "steps_and_one state"]
    actions: Float[np.ndarray, "steps action"]
    trust: Float[np.ndarray, " steps"]
    tree: SearchTree


@dataclass(frozen=True)
class TracedAction:
    """One executed action: of plan number `plan`, or the recovery after it. `state` is what was observed afterwards."""

    plan: int
    recovery: bool
    action: Float[np.ndarray, " action"]
    outcome: ActionOutcome
    seconds: float
    at_s: float
    state: Float[np.ndarray, " state"]
    error_m: float


@dataclass(frozen=True)
class Trace:
    """One trial. `result` is what its end event says; empty if the process was killed, and `outcome` interrupted."""

    about: Mapping[str, Any]
    layout: StateLayout
    start: Float[np.ndarray, " state"]
    start_error_m: float
    plans: tuple[TracedPlan, ...]
    actions: tuple[TracedAction, ...]
    outcome: TrialOutcome
    result: Mapping[str, Any]


def read_trace(folder: Path) -> Trace:
    """Read a trace, finished or not.

    Raises:
        ArtifactError: no trace in this folder, or a damaged one.
    """
    events = list(read_jsonl(folder / EVENTS))
    if not events or events[0].get("event") != "start":
        raise ArtifactError(folder / EVENTS, "not the trace of a trial: no start event")
    try:
        return _read(folder, events)
    except (KeyError, ValueError, BadZipFile) as error:
        raise ArtifactError(folder, f"a damaged trace ({type(error).__name__}: {error})") from None


def _read(folder: Path, events: list[dict[str, Any]]) -> Trace:
    start = events[0]
    state = np.array(start["state"], np.float32)
    result = {k: v for k, v in events[-1].items() if k != "event"} if events[-1]["event"] == "end" else {}
    return Trace(
        start["about"],
        StateLayout(tuple(start["layout"]["grippers"]), start["layout"]["points"]),
        state,
        start["error_m"],
        tuple(_plan(folder, event, state.size) for event in events if event["event"] == "plan"),
        tuple(_action(event) for event in events if event["event"] == "action"),
        TrialOutcome.of(result.get("outcome", TrialOutcome.INTERRUPTED.label)),
        result,
    )


def _plan(folder: Path, event: Mapping[str, Any], size: int) -> TracedPlan:
    head = event["index"], PlanOutcome.of(event["outcome"]), event["at_s"], event["extensions"]
    if event["arrays"] is None:
        nothing = np.zeros((0, size), np.float32)
        tree = SearchTree(nothing, np.zeros(0, np.int32), np.zeros(0, np.float32))
        return TracedPlan(*head, nothing, np.zeros((0, 0), np.float32), np.zeros(0, np.float32), tree)
    path = folder / event["arrays"]
    if not path.exists():
        raise ArtifactError(path, "missing, though the trace names it")
    with np.load(path, allow_pickle=False) as arrays:
        tree = SearchTree(arrays["tree_states"], arrays["tree_parents"], arrays["tree_trust"])
        return TracedPlan(*head, arrays["states"], arrays["actions"], arrays["trust"], tree)


def _action(event: Mapping[str, Any]) -> TracedAction:
    return TracedAction(
        event["plan"],
        event["recovery"],
        np.array(event["action"], np.float32),
        ActionOutcome.of(event["outcome"]),
        event["seconds"],
        event["at_s"],
        np.array(event["state"], np.float32),
        event["error_m"],
    )
