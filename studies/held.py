"""Sequences of held actions, one for each start: what they are worth, who acted them, and a search for better ones."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from stlbench.contract import ActionGrid, Actions, Array, Integers, RewardMethod
from stlbench.records.result import Score
from stlbench.simulation import baselines, referee
from stlbench.simulation.baselines import Unpaid
from stlbench.simulation.environment import Simulator
from stlbench.simulation.verdicts import judge
from stlbench.task import Task

_TRIES = 16
"""Changed sequences of each start that are simulated side by side."""
_SHIFTED, _HELD, _CROSSED = 0.15, 0.1, 0.1
"""Shares of changes that shift, that hold one action, and that take over a part of another sequence."""
_NEAR, _UNDONE, _TAIL, _BLOCK = 0.5, 0.7, 0.5, 4.0
"""Shares with two places that are near, with a change that is undone, and with all that follows taken over; the mean
number of decisions of a block."""
_SAY = 20.0
"""CPU seconds from one line to the next."""


def replay(task: Task, sequences: Array) -> Score:
    """The referee's score when the report's starts (N, s) are given the held actions (N, decisions, axes)."""
    return referee.score(task, _traces(task, task.starts.report_and_selection()[0], sequences))


def _traces(task: Task, begun: Array, sequences: Array) -> Array:
    """The traces (N, T + 1, k) that the sequences (N, decisions, axes) lead to."""
    return baselines.replay(task, taken(task, sequences), begun).traces


def taken(task: Task, vectors: Array) -> Integers | Array:
    """Actions (..., axes) as the task takes them: on a grid the places (...) of the nearest ones."""
    if not isinstance(task.actions, ActionGrid):
        return vectors
    return task.actions.nearest(vectors.reshape(-1, vectors.shape[-1])).reshape(vectors.shape[:-1])


def robustness_of(task: Task, begun: Array, sequences: Array) -> Array:
    """The robustness of the referee's score (N,), without the time that its other numbers take."""
    traces = _traces(task, begun, sequences)
    robustness: Array = judge(task.formula, traces, task.specification, task.file.terminated).robustness[:, 0]
    return robustness


def actions_of(
    task: Task, begun: Array, act: Callable[[Simulator], Array], method: RewardMethod | None = None
) -> Array:
    """The held actions (N, decisions, axes) of what acts, by the inputs of a method."""
    acted = list[Array]()

    def recording(simulator: Simulator) -> Integers | Array:
        acted.append(np.clip(act(simulator), task.actions.low, task.actions.high))
        return taken(task, acted[-1])

    referee.simulate(task, method or Unpaid(task.specification), recording, begun)
    return np.stack(acted, axis=1)


def crossed(
    task: Task, begun: Array, pool: Array, generator: np.random.Generator | None = None, noise: float = 0.0
) -> Array:
    """The best sequence (N, decisions, axes) from each start, of a pool (M, decisions, axes), by noisy values."""
    count = len(begun)
    value = robustness_of(task, np.repeat(begun, len(pool), axis=0), np.tile(pool, (count, 1, 1))).reshape(count, -1)
    if generator is not None:
        value = value + noise * generator.normal(size=value.shape)
    best: Array = pool[value.argmax(axis=1)]
    return best


def better(task: Task, begun: Array, one: Array, other: Array) -> Array:
    """The better of two sequences (N, decisions, axes) from each start."""
    wins = np.greater(robustness_of(task, begun, other), robustness_of(task, begun, one))
    return np.where(wins[:, None, None], other, one)


def search(task: Task, begun: Array, sequences: Array, seconds: float, seed: int = 0) -> Array:
    """Sequences (N, decisions, axes) that are no worse from any of the starts, after so many CPU seconds."""
    generator, clock = np.random.default_rng(seed), time.process_time
    best, end, said = robustness_of(task, begun, sequences), clock() + seconds, clock()
    rows = np.arange(len(begun))
    while clock() < end:
        tried = _changed(np.repeat(sequences, _TRIES, axis=0), task.actions, generator)
        found = robustness_of(task, np.repeat(begun, _TRIES, axis=0), tried).reshape(len(begun), _TRIES)
        winner = found.argmax(axis=1)
        better = found[rows, winner] >= best  # an equal one too: the search then leaves a plateau
        winners = tried.reshape(len(begun), _TRIES, *tried.shape[1:])[rows, winner]
        sequences = np.where(better[:, None, None], winners, sequences)
        best = np.where(better, found[rows, winner], best)
        if clock() - said > _SAY:
            said = clock()
            print(f"{end - said:6.0f} s left, {best.mean():.5f}, worst start {best.min():.5f}", flush=True)
    return sequences


def _changed(sequences: Array, actions: Actions, generator: np.random.Generator) -> Array:
    """Each of the sequences (N, decisions, axes) changed, mostly so that the rest of the way is moved and not turned.

    All actions between two decisions come one decision sooner or later; or a block holds an action that is taken
    somewhere; or a block, or all that follows, is that of another sequence. Most often one axis has more for some
    decisions, and as much less for as many others.
    """
    count, decisions, axes = sequences.shape
    rows, places = np.arange(count), np.arange(decisions)[None]
    first, second = generator.integers(decisions, size=(2, count, 1))
    other = generator.integers(count, size=(count, 1))
    kind = np.searchsorted(np.cumsum((_SHIFTED, _HELD, _CROSSED)), generator.random((count, 1)), side="right")
    block = first + 1 + generator.exponential(_BLOCK, (count, 1)).astype(np.int64)
    whole = (kind == 2) & (generator.random((count, 1)) < _TAIL)
    within = (kind > 0) & (kind < 3) & (places >= first) & (whole | (places < block))
    low, high = np.minimum(first, second), np.maximum(first, second) + 1
    sooner = low + (places - low + generator.choice((-1, 1), (count, 1))) % (high - low)
    place = np.where((kind == 0) & (places >= low) & (places < high), sooner, places)
    place = np.where((kind == 1) & within, second, place)
    changed: Array = sequences[np.where(within, other, rows[:, None]), place]
    axis, length = generator.integers(axes, size=count), 1 + generator.exponential(1.0, (count, 1)).astype(np.int64)
    near = generator.random((count, 1)) < _NEAR
    second = np.where(near, np.maximum(first + generator.integers(-8, 9, (count, 1)), 0), second)
    lower, upper = np.array(actions.low), np.array(actions.high)
    span = (upper - lower)[axis]
    if isinstance(actions, ActionGrid):
        steps = generator.choice((-1, 1), count) * generator.choice((1, 1, 2, 3), count)
        change = steps * span / (np.array(actions.shape)[axis] - 1)
    else:
        change = span * generator.normal(size=count) * 10 ** generator.uniform(-3, -0.5, count)
    undone = generator.random((count, 1)) < _UNDONE
    more = ((places >= first) & (places < first + length)).astype(np.float64)
    more -= undone & (places >= second) & (places < second + length)
    changed[rows, :, axis] += np.where(kind < 3, 0.0, change[:, None] * more)
    return np.clip(changed, lower, upper)
