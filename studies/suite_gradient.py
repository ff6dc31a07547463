"""Better actions by the gradient of a smooth robustness, for systems that are pure functions of state and action.

1. `ascend` improves continuous actions. It replaces minima and maxima by log-sum-exp (Pant, Abbas and Mangharam, CCTA
   2017) and linearises the system along the course. It changes actions with feedback from the state, as differential
   dynamic programming does (Li and Todorov, ICINCO 2004), so a pole that falls over stays up.
2. `follow` brings the course to the grid: at each decision it takes the action after which the rest of the course is
   cheapest to follow by a linear regulator. Many tries, each with some noise in these costs, are scored exactly.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from best_known import robustness_of

from stlbench import stl
from stlbench.contract import ActionGrid, Array
from stlbench.stl.language.syntax import Connective, Window
from stlbench.task import Task

_TEMPERATURES = (50.0, 100.0, 200.0)
_LENGTHS = np.array([1.0, 0.5, 0.25, 0.1, 0.03])
"""How much of a change is tried."""
_LEAST, _PATIENCE = 1e-4, 5
"""A gain of the mean, in so many changes, with which a temperature is done."""
_STATE, _EFFORT = 0.2, 1e-2
"""What following weighs beside the signals: each number of the state, and each action over its range."""
_TRIES = 16
_DIFFERENCE, _NEVER = 1e-6, 1e3


class Course(NamedTuple):
    """Continuous actions (N, decisions, axes), and the states (N, T + 1, n) that they lead to."""

    actions: Array
    states: Array


class Model(NamedTuple):
    """A system along a course, decision by decision: x' = A x + B u for small changes of its state and action.

    `by_state` (N, T + 1, n) are derivatives of the smooth robustness; `value` (N,) is that robustness.
    """

    value: Array
    by_state: Array
    a: Array  # (N, T, n, n), for each step
    b: Array  # (N, T, n, axes)


def improved(task: Task, begun: Array, sequences: Array, seconds: float) -> Array:
    """Sequences (N, decisions, axes) of the grid that are no worse from any start, after so many CPU seconds.

    Raises `ValueError` for a formula with operators that the suite does not draw.
    """
    begin = time.process_time()
    course = ascend(task, begun, sequences, begin + seconds / 2)
    return follow(task, begun, course, sequences, begin + seconds)


def ascend(task: Task, begun: Array, sequences: Array, end: float) -> Course:
    """A course from each start with a greater smooth robustness, found before `end` (CPU seconds of the process)."""
    course = Course(sequences.copy(), _states(task, begun, sequences))
    span, n, rows = np.subtract(task.actions.high, task.actions.low), course.states.shape[2], np.arange(len(begun))
    effort, wide = np.ones(len(begun)), np.repeat(begun, len(_LENGTHS), axis=0)
    for k in _TEMPERATURES:
        value, gains = _values(task, course.states, k), list[float]()
        while time.process_time() < end and (len(gains) < _PATIENCE or sum(gains[-_PATIENCE:]) > _LEAST):
            model = linearised(task, course, k)
            steps = _decisions(task, model)
            own = effort[:, None, None, None] * np.tile(np.eye(n), (1, steps.a.shape[1] + 1, 1, 1))
            change, gain, _ = _regulator(steps, own, effort[:, None, None] * np.diag(span**-2.0))
            before = (course.actions, course.states, change, gain)
            tried = _moved(task, wide, *(np.repeat(each, len(_LENGTHS), axis=0) for each in before))
            found = np.nan_to_num(_values(task, tried.states, k), nan=-np.inf).reshape(len(begun), -1)
            best = found.argmax(axis=1)
            better = found[rows, best] > value
            at = (rows * len(_LENGTHS) + best)[better]
            course.actions[better], course.states[better] = tried.actions[at], tried.states[at]
            gains.append(float(np.maximum(found[rows, best] - value, 0).mean()))
            value = np.maximum(value, found[rows, best])
            easier = np.where(best == 0, 1 / 3, np.where(best > 1, 2.0, 1.0))
            effort = np.clip(effort * np.where(better, easier, 5.0), 1e-4, 1e8)
    return course


def follow(task: Task, begun: Array, course: Course, sequences: Array, end: float) -> Array:
    """The best actions of the grid (N, decisions, axes) that were found before `end`; at least one try of each.

    They follow a course, or are the sequences where these are better.
    """
    best, robustness = sequences.copy(), robustness_of(task, begun, sequences)
    cost, generator, rows = _cost(task, course), np.random.default_rng(0), np.arange(len(begun))
    wide = [np.repeat(each, _TRIES, axis=0) for each in (begun, course.states, cost)]
    noise = np.tile([0.0, *np.geomspace(0.03, 1.0, _TRIES - 1)], len(begun))
    while True:
        tried = _followed(task, *wide, noise, generator)
        found = robustness_of(task, wide[0], tried).reshape(len(begun), _TRIES)
        top = found.argmax(axis=1)
        better = found[rows, top] > robustness
        best[better], robustness[better] = tried[rows * _TRIES + top][better], found[rows, top][better]
        if time.process_time() >= end:
            return best


def _followed(
    task: Task, begun: Array, states: Array, cost: Array, noise: Array, generator: np.random.Generator
) -> Array:
    """Actions (N, decisions, axes) of the grid by costs (N, decisions + 1, n, n) of being off states (N, T + 1, n)."""
    assert isinstance(task.actions, ActionGrid)
    grid, count, hold = task.actions.vectors, len(begun), task.file.hold
    found, state, held = list[Array](), begun, np.tile(grid, (count, 1))
    for decision in range(1, cost.shape[1]):
        after = np.repeat(state, len(grid), axis=0)
        for _ in range(hold):
            after = task.system.step(after, held)
        after = after.reshape(count, len(grid), -1)
        off = after - states[:, None, decision * hold]
        costs = ((off @ cost[:, decision]) * off).sum(axis=2)
        best = (costs * np.exp(noise[:, None] * generator.normal(size=costs.shape))).argmin(axis=1)
        found.append(grid[best])
        state = after[np.arange(count), best]
    return np.stack(found, axis=1)


def _cost(task: Task, course: Course) -> Array:
    """What it costs a regulator to be off the course by one, at each decision: (N, decisions + 1, n, n)."""
    states, hold = course.states[:, :: task.file.hold], task.file.hold
    n, span = states.shape[2], np.subtract(task.actions.high, task.actions.low)
    moves = _moves(task, course)
    still = Model(np.zeros(len(states)), np.zeros_like(course.states), moves[..., :n], moves[..., n:])
    seen = _derivatives(task.system.signals, states.reshape(-1, n)).reshape(*states.shape[:2], -1, n)
    own = seen.transpose(0, 1, 3, 2) @ seen + _STATE**2 * np.eye(n)
    assert course.states.shape[1] == hold * course.actions.shape[1] + 1
    return _regulator(_decisions(task, still), own, _EFFORT * np.diag(span**-2.0)[None])[2]


class _Decisions(NamedTuple):
    """A model in decisions in place of steps, with what a loss of one changes in the robustness, negated."""

    a: Array  # (N, decisions, n, n)
    b: Array  # (N, decisions, n, axes)
    by_state: Array  # (N, decisions, n), of the samples of the decision
    by_action: Array  # (N, decisions, axes)


def _decisions(task: Task, model: Model) -> _Decisions:
    hold, (count, steps, n, axes) = task.file.hold, model.b.shape
    parts = list[tuple[Array, Array, Array, Array]]()
    for first in range(0, steps, hold):
        a, b = np.tile(np.eye(n), (count, 1, 1)), np.zeros((count, n, axes))
        by_state, by_action = np.zeros((count, n)), np.zeros((count, axes))
        for t in range(first, first + hold):
            a, b = model.a[:, t] @ a, model.a[:, t] @ b + model.b[:, t]
            by_state -= _times(model.by_state[:, t + 1], a)
            by_action -= _times(model.by_state[:, t + 1], b)
        parts.append((a, b, by_state, by_action))
    return _Decisions(*(np.stack(each, axis=1) for each in zip(*parts, strict=True)))


def _regulator(steps: _Decisions, own: Array, effort: Array) -> tuple[Array, Array, Array]:
    """The best changes by a linear model and quadratic costs: changes, gains of the feedback, and costs of a state.

    Args:
        steps: the model, with linear costs.
        own: quadratic costs of states (N, decisions + 1, n, n).
        effort: those of actions (N or 1, axes, axes).
    """
    cost, slope = own.copy(), np.zeros(steps.by_state[:, 0].shape)
    change, gain = np.zeros_like(steps.by_action), np.zeros_like(steps.b.transpose(0, 1, 3, 2))
    for d in reversed(range(steps.a.shape[1])):
        a, b, later = steps.a[:, d], steps.b[:, d], cost[:, d + 1]
        back = b.transpose(0, 2, 1) @ later
        by_action, both = steps.by_action[:, d] + _times(slope, b), back @ a
        solved = np.linalg.solve(effort + back @ b, np.concatenate([by_action[..., None], both], axis=2))
        change[:, d], gain[:, d] = -solved[..., 0], -solved[..., 1:]
        slope = steps.by_state[:, d] + _times(slope, a) + _times(by_action, gain[:, d])
        whole = a.transpose(0, 2, 1) @ later @ a + both.transpose(0, 2, 1) @ gain[:, d]
        cost[:, d] += (whole + whole.transpose(0, 2, 1)) / 2
    return change, gain, cost


def _times(rows: Array, matrices: Array) -> Array:
    """(N, n), (N, n, m) -> (N, m)."""
    product: Array = (rows[:, None] @ matrices)[:, 0]
    return product


def _moved(task: Task, begun: Array, actions: Array, states: Array, change: Array, gain: Array) -> Course:
    """The courses with changed actions, for each start `_LENGTHS` of the change in turn."""
    length = np.tile(_LENGTHS, len(begun) // len(_LENGTHS))[:, None]
    state, taken, course = begun, list[Array](), [begun]
    for d in range(actions.shape[1]):
        off = state - states[:, d * task.file.hold]
        action = actions[:, d] + length * change[:, d] + (gain[:, d] @ off[..., None])[..., 0]
        taken.append(np.clip(action, task.actions.low, task.actions.high))
        for _ in range(task.file.hold):
            state = task.system.step(state, taken[-1])
            course.append(state)
    return Course(np.stack(taken, axis=1), np.stack(course, axis=1))


def _states(task: Task, begun: Array, actions: Array) -> Array:
    """The states (N, T + 1, n) under actions (N, decisions, axes)."""
    states = [begun]
    for t in range(task.file.steps):
        states.append(task.system.step(states[-1], actions[:, t // task.file.hold]))
    return np.stack(states, axis=1)


def linearised(task: Task, course: Course, k: float) -> Model:
    """The smooth robustness along a course, its derivatives by each state, and those of each step."""
    (*shape, n), flat = course.states.shape, course.states.reshape(-1, course.states.shape[2])
    signals = task.system.signals(flat)
    margins = _margins(task, course.states)
    smooth = _smooth(task.formula, margins, k, False)[:, 0]
    smooth.sum().backward()  # type: ignore[no-untyped-call]
    by_signals = np.zeros((len(flat), 1, signals.shape[1]))
    for each, values in margins.items():
        assert values.grad is not None
        slopes = _derivatives(stl.margin(each, task.signals), signals)
        by_signals += values.grad.numpy().reshape(-1, 1, 1) * slopes
    by_state = (by_signals @ _derivatives(task.system.signals, flat)).reshape(*shape, n)
    moves = _moves(task, course)
    return Model(smooth.detach().numpy(), by_state, moves[..., :n], moves[..., n:])


def _values(task: Task, states: Array, k: float) -> Array:
    """The smooth robustness (N,) of courses (N, T + 1, n)."""
    with torch.no_grad():
        return _smooth(task.formula, _margins(task, states), k, False)[:, 0].numpy()


def _margins(task: Task, states: Array) -> dict[stl.Formula, torch.Tensor]:
    """Of each predicate (N, T + 1)."""
    signals = task.system.signals(states.reshape(-1, states.shape[2]))
    margins = {each: stl.margin(each, task.signals)(signals) for each in dict.fromkeys(_predicates(task.formula))}
    return {each: torch.tensor(own.reshape(states.shape[:2]), requires_grad=True) for each, own in margins.items()}


def _moves(task: Task, course: Course) -> Array:
    """Derivatives (N, T, n, n + axes) of each step by state and action."""
    n, steps = course.states.shape[2], task.file.steps
    held = np.repeat(course.actions, task.file.hold, axis=1)[:, :steps]
    taking = np.concatenate([course.states[:, :-1], held], axis=2)
    moves = _derivatives(lambda both: task.system.step(both[:, :n], both[:, n:]), taking.reshape(-1, taking.shape[2]))
    return moves.reshape(len(held), steps, n, -1)


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
