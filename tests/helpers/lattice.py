"""Points that move on whole numbers, for proofs of planning: interpolation is exact there, and all plans can be tried.

The state moves by the action, x' = x + a with a in -1, 0, 1 along each axis. A grid with a point at each whole number
then has every state that occurs among its points.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import product
from typing import NamedTuple

import numpy as np

from helpers.stepwise import Stepwise, one_step
from stlbench import stl
from stlbench.contract import ActionGrid, Array, End, Integers, Model, RewardMethod, Specification, StatePolicy, System
from stlbench_planning.grid import ActionSet, Axis, Grid

REACH = 9
"""The grid is from -9 to 9: no plan of these tests gets there from near 0."""


class Lattice(System):
    """x' = x + a, on as many axes as there are names."""

    def __init__(self, names: tuple[str, ...]) -> None:
        super().__init__(1.0)
        self.state = names  # type: ignore[misc]

    def step(self, state: Array, action: Array) -> Array:
        return state + action

    def signals(self, state: Array) -> Array:
        return state

    def features(self, state: Array, t: Integers) -> Array:
        return state


class Paid(RewardMethod):
    """Pays for samples alone: a function of signals (..., k) and time (...)."""

    def __init__(self, specification: Specification, pay: Callable[[Array, Integers], Array]) -> None:
        super().__init__(specification)
        self.pay = pay

    def arrival(self, signals: Array, t: Integers) -> Array:
        return np.broadcast_to(self.pay(signals, t), signals.shape[:-1])


class Stepped(Stepwise):
    """Pays for transitions: a function of s_t, the action, s_{t+1} and t."""

    def __init__(self, specification: Specification, pay: Callable[[Array, Array, Array, Integers], Array]) -> None:
        super().__init__(specification)
        self.pay = pay

    def step(
        self, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array
    ) -> tuple[Array, Array]:
        return self.pay(signals, action, next_signals, t), memory


def specification(formula: str | stl.Formula, steps: int, names: tuple[str, ...] = ("x",)) -> Specification:
    parsed = stl.parse(formula) if isinstance(formula, str) else formula
    return Specification(parsed, names, (-REACH,) * len(names), (REACH,) * len(names), steps, 1.0)


def model(
    method: RewardMethod,
    hold: int = 1,
    cuts: tuple[int, ...] = (),
    ends: tuple[End, ...] = (),
    actions: ActionGrid | None = None,
) -> Model:
    """The lattice whose axes are the signals of the method's specification."""
    names, steps = method.specification.signals, method.specification.steps
    actions = actions or ActionGrid(names, ((-1.0, 0.0, 1.0),) * len(names))
    starts = np.zeros((1, len(names)))
    return Model(Lattice(names), method, method.specification.formula, actions, steps, hold, cuts, ends, starts)


def task(formula: str | stl.Formula, steps: int, hold: int = 1, names: tuple[str, ...] = ("x",)) -> Model:
    """The lattice with a formula, and no reward that matters."""
    return model(Paid(specification(formula, steps, names), lambda s, t: s[..., 0]), hold)


def whole(model: Model, reach: int = REACH) -> tuple[Grid, ActionSet]:
    """The grid with a point at each whole number from -reach to reach, and all actions."""
    axis = Axis(np.arange(-reach, reach + 1.0))
    return Grid((axis,) * len(model.system.state)), ActionSet.of(model.actions, 10_000)


class Plans(NamedTuple):
    """All plans from one start."""

    samples: Array
    """(T + 1, P, k)."""
    vectors: Array
    """(decisions, P, axes)."""


def every_plan(model: Model, start: Iterable[float]) -> Plans:
    """All sequences of actions, and where they lead."""
    decisions = model.decisions
    chosen = np.array(list(product(range(len(_vectors(model))), repeat=decisions))).T
    vectors = _vectors(model)[chosen]
    steps = np.repeat(vectors, model.hold, axis=0)
    first = np.broadcast_to(np.array(list(start), dtype=float), (1, *steps.shape[1:]))
    return Plans(np.concatenate([first, first + steps.cumsum(axis=0)]), vectors)


def returns(model: Model, plans: Plans, gamma: float, beyond: Callable[[Array], Array] | None = None) -> Array:
    """The discounted sum of each plan's rewards (P,), counted as training episodes count, in the method's unit.

    Args:
        beyond: what a sample (P, k) is worth, where the first cut is.
    """
    method, hold = model.method, model.hold
    count = plans.samples.shape[1]
    total, open_ = np.zeros(count), np.ones(count, dtype=bool)
    memory = method.initial_memory(plans.samples[0], np.zeros(count, dtype=np.int64))
    for d, vectors in enumerate(plans.vectors):
        rewards = np.zeros(count)
        for t in range(d * hold, (d + 1) * hold):
            now = np.full(count, t)
            paid, memory = one_step(method, plans.samples[t], vectors, plans.samples[t + 1], now, memory)
            rewards += paid / hold
        ended = np.zeros(count, dtype=bool)
        for end in model.ends:
            for t in range(d * hold + 1, (d + 1) * hold + 1):
                here = end.over(plans.samples[t]) & end.active[t] & ~ended
                left = len(plans.vectors) - d
                times = 1 if method.can_end else 1 / (1 - gamma) if gamma < 1 else left
                rewards[here] = end.reward * method.scale * times
                ended |= here
        total[open_] += gamma**d * rewards[open_]
        open_ &= ~ended
        if method.can_end:
            open_ &= ~method.over(memory)
        if (d + 1) * hold in model.cuts:
            if beyond is not None:
                total[open_] += gamma ** (d + 1) * beyond(plans.samples[(d + 1) * hold])[open_]
            return total
    return total


def robustness(model: Model, samples: Array) -> Array:
    """Of traces (T + 1, P, k): (P,)."""
    return stl.robustness(model.formula, samples.transpose(1, 0, 2), model.method.specification.signals)


def followed(model: Model, policy: StatePolicy, starts: Array) -> Plans:
    """What a policy does from starts (N, n), stepped on the true system with the method's own memory."""
    act, method = policy.episode(), model.method
    state, memory = starts, method.initial_memory(starts, np.zeros(len(starts), dtype=np.int64))
    samples, chosen = [state], []
    for d in range(model.decisions):
        t = np.full(len(starts), d * model.hold)
        action = np.asarray(act(state, t, memory))
        vectors = _vectors(model)[action] if action.dtype.kind == "i" else action
        path = [state]
        for _ in range(model.hold):
            path.append(model.system.step(path[-1], vectors))
        memory = method.along(np.stack(path), vectors, t, memory)[1]
        samples, chosen, state = [*samples, *path[1:]], [*chosen, vectors], path[-1]
    return Plans(np.stack(samples), np.stack(chosen))


def _vectors(model: Model) -> Array:
    assert isinstance(model.actions, ActionGrid)
    return model.actions.vectors
