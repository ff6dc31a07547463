"""The loops of planning, compiled: interpolation, and the steps of backward induction.

States are numbered S in all, actions A, values of a method's memory M, samples while an action is held H. A place on
a grid is the number of its lowest corner, -1 outside, and a weight for each axis; `strides` are the distances to the
next corner along each axis, the last of which is 1.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

from stlbench.contract import cached

Function = TypeVar("Function", bound=Callable[..., Any])
Floats = NDArray[Any]
Indices = NDArray[np.int32]
Strides = NDArray[np.int64]

_jitted = cast(Callable[[Function], Function], partial(numba.njit, error_model="numpy"))
inlined = cast(Callable[[Function], Function], partial(numba.njit, inline="always", error_model="numpy"))


def compiled(function: Function) -> Function:
    return cached(_jitted(function))


@inlined
def _line(values: Floats, at: int, weights: Floats) -> Any:
    return values[at] + weights[-1] * (values[at + 1] - values[at])


@inlined
def _plane(values: Floats, at: int, strides: Strides, weights: Floats) -> Any:
    low = _line(values, at, weights)
    return low + weights[-2] * (_line(values, at + strides[-2], weights) - low)


@inlined
def _space(values: Floats, at: int, strides: Strides, weights: Floats) -> Any:
    low = _plane(values, at, strides, weights)
    return low + weights[-3] * (_plane(values, at + strides[-3], strides, weights) - low)


@inlined
def _between(values: Floats, at: int, strides: Strides, weights: Floats) -> Any:
    """Multilinear interpolation in a flat grid of one to four axes."""
    axes = len(strides)
    if axes == 1:
        return _line(values, at, weights)
    if axes == 2:
        return _plane(values, at, strides, weights)
    if axes == 3:
        return _space(values, at, strides, weights)
    low = _space(values, at, strides, weights)
    return low + weights[-4] * (_space(values, at + strides[-4], strides, weights) - low)


@compiled
def interpolate(values: Floats, at: Indices, weights: Floats, strides: Strides, outside: float, into: Floats) -> None:
    """Values (S,) of a grid at places (N,), weights (N, axes): into (N,)."""
    for i in range(len(at)):
        into[i] = _between(values, at[i], strides, weights[i]) if at[i] >= 0 else outside


@compiled
def mean_rewards(tables: Floats, at: Indices, weights: Floats, strides: Strides, into: Floats) -> None:
    """Mean rewards (A, 1, S) over samples of held actions at places (A, S, H), by tables over signals (H, cells)."""
    for a in range(at.shape[0]):
        for s in range(at.shape[1]):
            total = 0.0
            for h in range(at.shape[2]):
                total += _between(tables[h], at[a, s, h], strides, weights[a, s, h])
            into[a, 0, s] = total / at.shape[2]


@compiled
def pay_best(
    later: Floats, at: Indices, weights: Floats, strides: Strides, rewards: Floats, memory: Indices, ended: Floats,
    over: Floats, gamma: float, lost: float, into: Floats,
) -> None:  # fmt: skip
    """One step back: the greatest reward (A, M, S) plus gamma times the value later (M, S), into (M, S).

    Places of the next states are (A, S), their weights (A, S, axes). `memory` (A, M, S) numbers the next memories, or
    is empty if there is one. `ended` (A, S) has the whole return of decisions that end an episode and NaN for others,
    or is empty if none does. `over` (M,) has the value after a memory that ends an episode, and NaN for others. A state
    outside the grid is worth `lost`, unless the episode ended.
    """
    into[:] = -np.inf
    for a in range(at.shape[0]):
        for s in range(at.shape[1]):
            is_end = ended.size > 0 and not np.isnan(ended[a, s])
            for m in range(into.shape[0]):
                then = memory[a, m, s] if memory.size else 0
                if is_end:
                    value = ended[a, s]
                elif not np.isnan(over[then]):
                    value = rewards[a, m, s] + gamma * over[then]
                elif at[a, s] < 0:
                    value = lost
                else:
                    value = rewards[a, m, s] + gamma * _between(later[then], at[a, s], strides, weights[a, s])
                into[m, s] = max(into[m, s], value)


@compiled
def reach_best(
    later: Floats, at: Indices, weights: Floats, strides: Strides, paid: Floats, lost: float, into: Floats
) -> None:
    """One step back of a minimum: the greatest min(paid (A, S), value later (S,)), where it is more than `into`."""
    for a in range(at.shape[0]):
        for s in range(at.shape[1]):
            value = lost if at[a, s] < 0 else _between(later, at[a, s], strides, weights[a, s])
            into[s] = max(into[s], min(value, paid[a, s]))


@compiled
def extremes(margins: Floats, active: NDArray[np.bool_], least: bool, into: Floats) -> None:
    """The least or greatest margin (A, S, H) of a held action's active samples (H,): (A, S)."""
    sign = 1.0 if least else -1.0
    for a in range(margins.shape[0]):
        for s in range(margins.shape[1]):
            extreme = np.inf
            for h in range(margins.shape[2]):
                if active[h]:
                    extreme = min(extreme, sign * margins[a, s, h])
            into[a, s] = sign * extreme


def compile_all() -> None:
    values, weights = np.zeros((1, 2), np.float32), np.zeros((1, 1, 1), np.float32)
    at, strides, active = np.zeros((1, 1), np.int32), np.ones(1, np.int64), np.ones(1, np.bool_)
    many, table = np.zeros((1, 1, 1), np.float32), np.zeros((1, 1), np.float32)
    interpolate(values[0], at[0], weights[0], strides, 0.0, values[0].copy())
    mean_rewards(values, at[None], weights[None], strides, many)
    pay_best(values, at, weights, strides, many, at[None], table, values[0], 1.0, 0.0, values.copy())
    reach_best(values[0], at, weights, strides, table, 0.0, values[0].copy())
    extremes(many, active, True, table)
