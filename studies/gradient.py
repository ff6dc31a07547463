"""Better actions by the gradient of a smooth robustness, for systems that are pure functions of state and action.

1. `ascend` improves continuous actions. It replaces minima and maxima by log-sum-exp (Pant, Abbas and Mangharam, CCTA
   2017) and linearises the system along the course. It changes actions with feedback from the state, as differential
   dynamic programming does (Li and Todorov, ICINCO 2004), so a pole that falls over stays up.
2. `follow` brings the course to the grid: at each decision it takes the action after which the rest of the course is
   cheapest to follow by a linear regulator. Many tries, each with some noise in these costs, are scored exactly.
"""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np
from held import robustness_of
from smooth import derivatives, slope, value_of

from stlbench.contract import ActionGrid, Array
from stlbench.task import Task

_TEMPERATURES = (50.0, 100.0, 200.0)
_LENGTHS = np.array([1.0, 0.5, 0.25, 0.1, 0.03])
"""The shares of a change that are tried."""
_LEAST, _PATIENCE = 1e-4, 5
"""A temperature is done if the mean gains less than this in that many changes."""
_STATE, _EFFORT = 0.2, 1e-2
"""Weights in following beside that of the signals: of each number of the state, and of each action over its range."""
_TRIES = 16


class Course(NamedTuple):
    """Continuous actions (N, decisions, axes), and the states (N, T + 1, n) that they lead to."""

    actions: Array
    states: Array


class Model(NamedTuple):
    """A system along a course: for small changes of state and action, the next state changes by A x + B u."""

    by_state: Array  # (N, T + 1, n): the derivatives of what is to grow
    a: Array  # (N, T, n, n)
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
        value, gains = value_of(task, course.states, k), list[float]()
        while time.process_time() < end and (len(gains) < _PATIENCE or sum(gains[-_PATIENCE:]) > _LEAST):
            steps = _decisions(task, linearised(task, course, slope(task, course.states, k)))
            own = effort[:, None, None, None] * np.tile(np.eye(n), (1, steps.a.shape[1] + 1, 1, 1))
            change, gain, _ = _regulator(steps, own, effort[:, None, None] * np.diag(span**-2.0))
            before = (course.actions, course.states, change, gain)
            tried = _moved(task, wide, *(np.repeat(each, len(_LENGTHS), axis=0) for each in before))
            found = np.nan_to_num(value_of(task, tried.states, k), nan=-np.inf).reshape(len(begun), -1)
            best = found.argmax(axis=1)
            better = found[rows, best] > value
            at = (rows * len(_LENGTHS) + best)[better]
            course.actions[better], course.states[better] = tried.actions[at], tried.states[at]
            gains.append(float(np.maximum(found[rows, best] - value, 0).mean()))
            value = np.maximum(value, found[rows, best])
            # The model holds for greater changes if whole ones are good, and for smaller ones if only short ones are.
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
    """The cost for a regulator of being off the course by one, at each decision: (N, decisions + 1, n, n)."""
    states = course.states[:, :: task.file.hold]
    n, span = states.shape[2], np.subtract(task.actions.high, task.actions.low)
    still = linearised(task, course, np.zeros_like(course.states))
    seen = derivatives(task.system.signals, states.reshape(-1, n)).reshape(*states.shape[:2], -1, n)
    own = seen.transpose(0, 1, 3, 2) @ seen + _STATE**2 * np.eye(n)
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
    cost, back = own.copy(), np.zeros(steps.by_state[:, 0].shape)
    change, gain = np.zeros_like(steps.by_action), np.zeros_like(steps.b.transpose(0, 1, 3, 2))
    for d in reversed(range(steps.a.shape[1])):
        a, b, later = steps.a[:, d], steps.b[:, d], cost[:, d + 1]
        seen = b.transpose(0, 2, 1) @ later
        by_action, both = steps.by_action[:, d] + _times(back, b), seen @ a
        solved = np.linalg.solve(effort + seen @ b, np.concatenate([by_action[..., None], both], axis=2))
        change[:, d], gain[:, d] = -solved[..., 0], -solved[..., 1:]
        back = steps.by_state[:, d] + _times(back, a) + _times(by_action, gain[:, d])
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


def linearised(task: Task, course: Course, by_state: Array) -> Model:
    """The system along a course, with the derivatives of what is to grow by its states (N, T + 1, n)."""
    n, steps = course.states.shape[2], task.file.steps
    held = np.repeat(course.actions, task.file.hold, axis=1)[:, :steps]
    taking = np.concatenate([course.states[:, :-1], held], axis=2)
    moves = derivatives(lambda both: task.system.step(both[:, :n], both[:, n:]), taking.reshape(-1, taking.shape[2]))
    moves = moves.reshape(len(held), steps, n, -1)
    return Model(by_state, moves[..., :n], moves[..., n:])
