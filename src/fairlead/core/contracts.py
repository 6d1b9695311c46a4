"""One contract for each role: what every implementation must do, a user's own too.

Each function calls an implementation and raises AssertionError with a sentence where it breaks the contract. They need
examples to call it with: a handful of states and actions of the user's own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome, Transitions
from fairlead.core.roles import (
    ActionSampler,
    Dynamics,
    Environment,
    Goal,
    RecoveryPolicy,
    TransitionCheck,
    World,
)

Arrays = Sequence[np.ndarray]


def _require(condition: bool | np.bool_, sentence: str) -> None:
    if not condition:
        raise AssertionError(sentence)


def _check_array(name: str, value: Any, shape: tuple[int, ...]) -> None:
    _require(isinstance(value, np.ndarray), f"{name} must be a numpy array, not {type(value).__name__}")
    _require(value.shape == shape, f"{name} must have shape {shape}, not {value.shape}")
    _require(np.issubdtype(value.dtype, np.floating), f"{name} must be floating point, not {value.dtype}")
    _require(bool(np.isfinite(value).all()), f"{name} must be finite for finite input")


def _same(one: np.ndarray, other: np.ndarray) -> bool:
    return np.array_equal(one, other, equal_nan=np.asarray(one).dtype.kind == "f")


def _call_untouched(name: str, function: Callable[..., Arrays], arguments: Arrays) -> Arrays:
    """Call twice: the inputs stay as they were, and the answers agree bit for bit."""
    before = [argument.copy() for argument in arguments]
    first, second = function(*arguments), function(*arguments)
    _require(all(map(np.array_equal, arguments, before)), f"{name} must not change its inputs")
    _require(all(map(_same, first, second)), f"{name} must give the same answer to the same input")
    return first


def _check_rows(name: str, function: Callable[..., Arrays], arguments: Arrays, tolerance: float) -> None:
    """A row alone gives what it gives within a batch."""
    together = function(*arguments)
    for row in range(len(arguments[0])):
        alone = function(*(argument[row : row + 1] for argument in arguments))
        close = all(
            np.allclose(a[0], b[row], rtol=tolerance, atol=tolerance) for a, b in zip(alone, together, strict=True)
        )
        _require(close, f"{name}: row {row} alone must give what it gives within a batch")


def check_dynamics(
    dynamics: Dynamics,
    environment: Environment,
    states: Float[np.ndarray, "batch state"],
    actions: Float[np.ndarray, "batch action"],
    tolerance: float = 1e-4,
) -> None:
    """Shapes, finite numbers, a spread that is not negative; rows are independent, inputs stay, answers repeat."""

    def predict(states: np.ndarray, actions: np.ndarray) -> Arrays:
        prediction = dynamics.predict(environment, states, actions)
        return prediction.mean, prediction.spread

    _require(states.shape[1] == dynamics.layout.state_size, "the example states must fit the layout of the dynamics")
    mean, spread = _call_untouched("predict", predict, (states, actions))
    _check_array("the predicted mean", mean, states.shape)
    _check_array("the predicted spread", spread, (len(states),))
    _require(bool((spread >= 0).all()), "the predicted spread must not be negative")
    _check_rows("predict", predict, (states, actions), tolerance)


def check_transition_check(
    check: TransitionCheck, environment: Environment, transitions: Transitions, tolerance: float = 1e-4
) -> None:
    """Encodings are float32 rows, probabilities lie in [0, 1]; rows are independent, inputs stay, answers repeat."""

    def encode(states: np.ndarray) -> Arrays:
        return (check.encode(environment, states),)

    def probability(*columns: np.ndarray) -> Arrays:
        return (check.probability(environment, Transitions(*columns[:4]), columns[4], columns[5]),)

    (encodings,) = _call_untouched("encode", encode, (transitions.states,))
    _check_array("the encoding", encodings, (len(transitions), *encodings.shape[1:]))
    _require(
        encodings.ndim == 2 and encodings.dtype == np.float32, "an encoding must be one float32 row for each state"
    )
    _check_rows("encode", encode, (transitions.states,), tolerance)
    columns = (transitions.states, transitions.actions, transitions.next_states, transitions.spread,
               encodings, check.encode(environment, transitions.next_states))  # fmt: skip
    (chance,) = _call_untouched("probability", probability, columns)
    _check_array("the probability", chance, (len(transitions),))
    _require(bool(((chance >= 0) & (chance <= 1)).all()), "a probability must lie in [0, 1]")
    _check_rows("probability", probability, columns, tolerance)


def check_sampler(sampler: ActionSampler, states: Float[np.ndarray, "batch state"], layout: StateLayout) -> None:
    """Proposals follow the generator alone; repeating an action from where it started gives that action."""

    def propose(states: np.ndarray) -> Arrays:
        return (sampler.propose(states, np.random.default_rng(7)),)

    (actions,) = _call_untouched("propose", propose, (states,))
    _check_array("a proposed action", actions, (len(states), layout.action_size))
    other = sampler.propose(states, np.random.default_rng(8))
    _require(not np.array_equal(actions, other), "propose must draw from the generator that it is given")
    (again,) = _call_untouched("repeat", lambda *a: (sampler.repeat(*a),), (states, actions, states))
    _check_array("a repeated action", again, actions.shape)
    _require(np.allclose(again, actions), "an action repeated from its own state must be that action")
    (allowed,) = _call_untouched("allows", lambda *a: (sampler.allows(*a),), (states, actions))
    _require(allowed.shape == (len(states),) and allowed.dtype == bool, "allows must answer yes or no for each action")


def check_recovery(
    recovery: RecoveryPolicy, environment: Environment, states: Float[np.ndarray, "batch state"], layout: StateLayout
) -> None:
    """One action for each state, or None; once it has forgotten, the same for the same generator."""

    def choose(states: np.ndarray) -> Arrays:
        recovery.forget()
        actions = recovery.choose(environment, states, np.random.default_rng(7))
        return () if actions is None else (actions,)

    for actions in _call_untouched("choose", choose, (states,)):
        _check_array("a recovery action", actions, (len(states), layout.action_size))


def check_goal(goal: Goal, states: Float[np.ndarray, "batch state"]) -> None:
    """Errors are distances, within the tolerance in the goal; a sample is in the goal, or at least no farther from it.

    A state without a batch axis is understood.
    """

    def error(states: np.ndarray) -> Arrays:
        return (goal.error(states),)

    (errors,) = _call_untouched("error", error, (states,))
    _check_array("the error", errors, (len(states),))
    _require(bool((errors >= 0).all()), "the error must not be negative")
    _check_rows("error", error, (states,), 1e-9)
    _require(np.allclose(goal.error(states[0]), errors[0]), "error must also take a state without a batch axis")
    before = states.copy()
    sampled = goal.sample(states, np.random.default_rng(7))
    _require(np.array_equal(states, before), "sample must not change its input")
    _check_array("a sample of the goal", sampled, states.shape)
    nearer = goal.reached(sampled) | (goal.error(sampled) <= errors)
    _require(bool(nearer.all()), "a sample of the goal must be in the goal, or no farther from it than it was")


def check_world(world: World, actions: Float[np.ndarray, "batch action"]) -> None:
    """Observing changes nothing; executing returns what is then observed, in no negative time, with known outcomes."""
    first, second = world.observe(), world.observe()
    _check_array("the observed state", first, (len(actions), world.layout.state_size))
    _require(np.array_equal(first, second), "observing a world twice must give the same state")
    first += 1.0
    _require(np.array_equal(world.observe(), second), "an observation must be the caller's own copy")
    before = actions.copy()
    executed = world.execute(actions)
    _require(np.array_equal(actions, before), "execute must not change its input")
    _check_array("the executed state", executed.states, second.shape)
    _check_array("the seconds of an action", executed.seconds, (len(actions),))
    _require(bool((executed.seconds >= 0).all()), "an action must not take negative time")
    known = np.isin(executed.outcomes, np.arange(len(ActionOutcome)))
    _require(bool(known.all()), "an outcome must be an index into ActionOutcome")
    _require(np.array_equal(world.observe(), executed.states), "a world must be observed where it says it is")
