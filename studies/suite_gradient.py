"""Ascent of a smooth robustness over continuous actions, which are then brought to the grid.

The minima and maxima are those of `semantics="smooth"`: log-sum-exp with temperature k (Pant, Abbas and Mangharam,
2017). torch differentiates the formula; central differences give the derivatives of margins, signals and steps; the
adjoint equation brings them back along the course. A system must be a pure function of state and action.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import torch
from best_known import robustness_of, taken

from stlbench import stl
from stlbench.contract import ActionGrid, Array
from stlbench.stl.language.syntax import Connective, Window
from stlbench.task import Task

_TEMPERATURES = (50.0, 100.0, 200.0)
_RATE, _CHECK, _WORSE = 0.01, 10, 0.02
"""By what share of its range an action changes; after how many steps the robustness is looked at; a loss undone."""
_STATE = 0.2
"""What a scaled state counts beside the signals, where a course on the grid follows one that is continuous."""
_DIFFERENCE = 1e-6
_NEVER = 1e3


def ascend(task: Task, begun: Array, sequences: Array, seconds: float) -> Array:
    """Sequences (N, decisions, axes) of the grid that are no worse from any start, after so many CPU seconds.

    Raises `ValueError` for a formula with operators that the suite does not draw.
    """
    low, high, begin = np.array(task.actions.low), np.array(task.actions.high), time.process_time()
    best, robustness = sequences.copy(), robustness_of(task, begun, sequences)
    top, reached, rates = sequences.copy(), _exact(task, begun, sequences), np.full((len(begun), 1, 1), _RATE)
    for number, k in enumerate(_TEMPERATURES, 1):
        actions, first, second, count = top.copy(), np.zeros_like(top), np.zeros_like(top), 0
        while time.process_time() - begin < seconds * number / len(_TEMPERATURES):
            count += 1
            slope = gradient(task, begun, actions, k)[1]
            slope /= np.sqrt((slope**2).mean(axis=(1, 2), keepdims=True)) + 1e-12
            first, second = 0.9 * first + 0.1 * slope, 0.99 * second + 0.01 * slope**2
            change = first / (1 - 0.9**count) / (np.sqrt(second / (1 - 0.99**count)) + 1e-12)  # Adam
            actions = np.clip(actions + rates * (high - low) * change, low, high)
            if count % _CHECK == 0:
                value = _exact(task, begun, actions)
                up, down = value > reached, value < reached - _WORSE
                top[up], reached[up] = actions[up], value[up]
                actions[down], first[down] = top[down], 0.0
                rates[down] /= 2
        for tried in (rounded(task, top), followed(task, begun, top)):
            value = robustness_of(task, begun, tried)
            better = value > robustness
            best[better], robustness[better] = tried[better], value[better]
        rates = np.minimum(2 * rates, _RATE)
    return best


def gradient(task: Task, begun: Array, actions: Array, k: float) -> tuple[Array, Array]:
    """The smooth robustness (N,) from each start, and its derivatives by the actions (N, decisions, axes)."""
    system, steps, hold = task.system, task.file.steps, task.file.hold
    states = _course(task, begun, actions)
    shape, n = states.shape[:2], states.shape[2]
    flat = states.reshape(-1, n)
    signals = system.signals(flat)
    margins = dict[stl.Formula, torch.Tensor]()
    for each in dict.fromkeys(_predicates(task.formula)):
        values = stl.margin(each, task.signals)(signals).reshape(shape)
        margins[each] = torch.tensor(values, requires_grad=True)
    smooth = _smooth(task.formula, margins, k, False)[:, 0]
    smooth.sum().backward()  # type: ignore[no-untyped-call]
    by_signals = np.zeros((len(flat), 1, signals.shape[1]))
    for each, values in margins.items():
        assert values.grad is not None
        slopes = _derivatives(stl.margin(each, task.signals), signals)
        by_signals += values.grad.numpy().reshape(-1, 1, 1) * slopes
    by_state = (by_signals @ _derivatives(system.signals, flat)).reshape(*shape, n)
    taking = np.concatenate([states[:, :-1], np.repeat(actions, hold, axis=1)[:, :steps]], axis=2)
    moving = _derivatives(lambda both: system.step(both[:, :n], both[:, n:]), taking.reshape(-1, taking.shape[2]))
    moves, slope, back = moving.reshape(len(begun), steps, n, -1), np.zeros_like(actions), by_state[:, -1]
    for t in reversed(range(steps)):
        earlier = (back[:, None] @ moves[:, t])[:, 0]
        slope[:, t // hold] += earlier[:, n:]
        back = by_state[:, t] + earlier[:, :n]
    return smooth.detach().numpy(), slope


def rounded(task: Task, actions: Array) -> Array:
    """The nearest actions of the grid, where what was lost by rounding is made up for by the next."""
    assert isinstance(task.actions, ActionGrid)
    found, owed = np.empty_like(actions), np.zeros_like(actions[:, 0])
    pitch = np.array([axis[1] - axis[0] for axis in task.actions.axes])
    for decision in range(actions.shape[1]):
        wanted = actions[:, decision] + owed
        found[:, decision] = task.actions.vectors[taken(task, wanted)]
        owed = np.clip(wanted - found[:, decision], -pitch, pitch)
    return found


def followed(task: Task, begun: Array, actions: Array) -> Array:
    """At each decision the action of the grid after which the course is nearest to that of continuous actions."""
    assert isinstance(task.actions, ActionGrid)
    grid, rows, hold = task.actions.vectors, np.arange(len(begun)), task.file.hold
    wanted, found, state = _course(task, begun, actions)[:, hold::hold], np.empty_like(actions), begun
    tried = np.tile(grid, (len(begun), 1))
    for decision in range(actions.shape[1]):
        states = np.repeat(state, len(grid), axis=0)
        for _ in range(hold):
            states = task.system.step(states, tried)
        goal = np.repeat(wanted[:, decision], len(grid), axis=0)
        off = np.square(task.system.signals(states) - task.system.signals(goal)).sum(axis=1)
        scaled = task.system.scaled_state(states) - task.system.scaled_state(goal)
        choice = (off + np.square(_STATE * scaled).sum(axis=1)).reshape(len(begun), -1).argmin(axis=1)
        found[:, decision], state = grid[choice], states.reshape(len(begun), len(grid), -1)[rows, choice]
    return found


def _course(task: Task, begun: Array, actions: Array) -> Array:
    """The states (N, T + 1, n) under actions (N, decisions, axes)."""
    states = [begun]
    for t in range(task.file.steps):
        states.append(task.system.step(states[-1], actions[:, t // task.file.hold]))
    return np.stack(states, axis=1)


def _exact(task: Task, begun: Array, actions: Array) -> Array:
    """The robustness (N,) under actions (N, decisions, axes) that need not be of the grid."""
    return stl.robustness(task.formula, task.system.signals(_course(task, begun, actions)), task.signals)


def _derivatives(function: Callable[[Array], Array], at: Array) -> Array:
    """Of a function of points (M, n), by central differences: (M, values, n)."""
    n = at.shape[1]
    moved = np.concatenate([np.eye(n), -np.eye(n)]) * _DIFFERENCE
    values = function((at[:, None] + moved).reshape(-1, n)).reshape(len(at), 2, n, -1)
    slopes: Array = (values[:, 0] - values[:, 1]) / (2 * _DIFFERENCE)
    return slopes.transpose(0, 2, 1)


def _predicates(formula: stl.Formula) -> list[stl.Formula]:
    if isinstance(formula, stl.Predicate):
        return [formula]
    return [each for operand in formula.operands for each in _predicates(operand)]  # type: ignore[arg-type]


def _smooth(formula: stl.Formula, margins: dict[stl.Formula, torch.Tensor], k: float, negated: bool) -> torch.Tensor:
    """The smooth robustness (N, L) of a part, or of its negation, at the first L steps: as many as the trace allows."""

    def least(values: torch.Tensor, dim: int) -> torch.Tensor:
        return -torch.logsumexp(-k * values, dim) / k

    def most(values: torch.Tensor, dim: int) -> torch.Tensor:
        return torch.logsumexp(k * values, dim) / k

    match formula:
        case stl.Predicate():
            return -margins[formula] if negated else margins[formula]
        case Connective():
            parts = [_smooth(each, margins, k, sign != negated) for each, sign in formula.signed]
            length = min(each.shape[1] for each in parts)
            fold = least if formula.least != negated else most
            return fold(torch.stack([each[:, :length] for each in parts]), 0)
        case Window(a=a, b=b, arg=arg, past=False):
            fold = least if formula.least != negated else most
            return fold(_smooth(arg, margins, k, negated)[:, a:].unfold(1, b - a + 1, 1), 2)
        case stl.Until(a=0, b=b, left=left, right=right) if not negated:  # at step 0 alone
            before = -torch.logcumsumexp(-k * _smooth(left, margins, k, False)[:, :b], 1) / k
            before = torch.cat([torch.full_like(before[:, :1], _NEVER), before], 1)
            return most(least(torch.stack([before, _smooth(right, margins, k, False)[:, : b + 1]]), 0), 1)[:, None]
    raise ValueError(f"no gradient for {formula}")
