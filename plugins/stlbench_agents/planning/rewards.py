"""Rewards for each action from each state of a grid, and the values of a method's memory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import Array, Model, Unsuitable
from stlbench_agents.planning.grid import Axis, Floats, Grid, Places
from stlbench_agents.planning.loops import mean_rewards
from stlbench_agents.planning.moves import ActionSet, simulated


@dataclass(frozen=True)
class Limits:
    values: int = 64  # the most that are enumerated
    rounded: int = 0  # to how many a memory of one number is rounded that takes more; 0: such a memory is refused

    def rounds(self, distinct: Array) -> bool:
        """Whether these values (M, m) of a memory must be rounded. Raises `Unsuitable` if they cannot."""
        if len(distinct) <= self.values:
            return False
        if self.rounded > 1 and distinct.shape[1] == 1:
            return True
        raise Unsuitable(
            f"a memory of {distinct.shape[1]} numbers that takes more than {self.values} values; a planner enumerates "
            "them, as many as memories= says, or rounds one number to rounded= values"
        )


USUAL = Limits()


@dataclass(frozen=True)
class Memories:
    """Each value that a memory takes, a row; of a method without memory there is one, which is empty."""

    values: Array  # (M, m)

    def __len__(self) -> int:
        return len(self.values)

    @classmethod
    def none(cls) -> Memories:
        return cls(np.empty((1, 0)))

    @classmethod
    def of(cls, model: Model, probes: Array, actions: ActionSet, limits: Limits) -> Memories:
        """The memories that random actions give from the states `probes` (N, n), at any decision.

        Raises `Unsuitable` if they are more than `limits` allows.
        """
        method = model.method
        if not method.memory_size:
            return cls.none()
        chosen = actions.vectors[np.random.default_rng(0).integers(len(actions), size=len(probes))]
        _, samples = simulated(model, probes, chosen)
        first = np.concatenate([model.system.signals(model.starts), samples[0]])
        known = np.unique(method.initial_memory(first, np.zeros(len(first), dtype=np.int64)), axis=0)
        spaced = limits.rounds(known)
        for t in range(0, model.steps, model.hold):
            times = np.full(len(probes), t)
            then = [method.along(samples, chosen, times, np.tile(row, (len(probes), 1)))[1] for row in known]
            known = np.unique(np.concatenate([known, *then]), axis=0)
            spaced = spaced or limits.rounds(known)
            known = np.linspace(known[0], known[-1], limits.rounded) if spaced else known
        return cls(known)

    def numbers(self, memory: Array) -> NDArray[np.int32]:
        """The number of each row's value (N, m), or of a value near it."""
        if len(self) == 1:
            return np.zeros(len(memory), dtype=np.int32)
        direction = np.random.default_rng(0).random(self.values.shape[1]) + 0.5  # tells all values apart
        keys, wanted = self.values @ direction, memory @ direction
        ranks = np.argsort(keys)
        ascending = keys[ranks]
        right = np.clip(np.searchsorted(ascending, wanted), 1, len(self) - 1)
        nearer = np.where(wanted - ascending[right - 1] <= ascending[right] - wanted, right - 1, right)
        numbers: NDArray[np.int32] = ranks[nearer].astype(np.int32)
        return numbers


MOST_SIGNALS = 4  # the most dimensions of a grid, and so of one of signals
_CELLS = 150_000  # about the most points of the grid of signals


class Arrivals:
    """The rewards of a method with `arrival`, for each action from each state at a decision."""

    def __init__(self, model: Model, grid: Grid, actions: ActionSet) -> None:
        self.memories = Memories.none()
        self._model = model
        samples = np.empty((len(actions), grid.size, model.hold), np.int32)
        self._signals = _signal_grid(model, grid)
        self._samples = Places(samples, np.empty((*samples.shape, len(self._signals.axes)), np.float32))
        self._tables: Floats = np.empty(0)
        self._rewards = np.empty((len(actions), 1, grid.size), np.float32)
        self._memory = np.empty((0, 0, 0), np.int32)

    def observe(self, action: int, samples: Array) -> None:
        places = self._signals.places(samples[1:].transpose(1, 0, 2), clip=True)
        self._samples.at[action], self._samples.weights[action] = places

    def at(self, decision: int) -> tuple[Floats, Floats]:
        """Rewards (A, 1, S) over the method's scale; no next memories."""
        hold, method = self._model.hold, self._model.method
        points, t = self._signals.points, decision * hold + np.arange(1, hold + 1)
        paid = [method.arrival(points, np.full(len(points), step)) / method.scale for step in t]
        tables = np.stack(paid).astype(np.float32)
        if not np.array_equal(tables, self._tables):
            refuse_nan(tables)
            mean_rewards(tables, *self._samples, self._signals.strides, self._rewards)
            self._tables = tables
        return self._rewards, self._memory


def refuse_nan(rewards: Floats) -> None:
    """Raises `ValueError`, since a maximum would pass over such a reward without a word."""
    if np.isnan(rewards).any():
        raise ValueError("on the planner's grid, the method's reward is sometimes not a number")


def _signal_grid(model: Model, grid: Grid) -> Grid:
    """A grid of the signals that occur; a signal that is a column of the state has that column's axis, made finer."""
    states = grid.points
    signals = model.system.signals(states)
    count = signals.shape[1]
    axes = []
    for j in range(count):
        same = [i for i in range(states.shape[1]) if np.array_equal(states[:, i], signals[:, j])]
        column = Axis(grid.axes[same[0]].points) if same else None  # without a period, which a signal need not have
        axes.append(column or _even(signals[:, j], int(_CELLS ** (1 / count))))
    points = float(np.prod([len(axis) for axis in axes]))
    finer = max(1, int((_CELLS / points) ** (1 / count)))
    return Grid(tuple(axis.finer(finer) for axis in axes))


def _even(values: Array, points: int) -> Axis:
    low, high = values.min(), values.max()
    return Axis(np.linspace(low, high if high > low else low + 1, points))


_PROBES = 4096  # states, each with a random action, whose rewards distinguish decisions
CACHED = 2  # tables of rewards in memory at a time


class Transitions:
    """The rewards of any method, for each action from each state at a decision, and its next memories."""

    def __init__(self, model: Model, grid: Grid, actions: ActionSet, limits: Limits) -> None:
        generator = np.random.default_rng(1)
        self._model, self._grid, self._actions = model, grid, actions
        states = grid.points[generator.integers(grid.size, size=_PROBES)]
        self._chosen = actions.vectors[generator.integers(len(actions), size=_PROBES)]
        _, self._probes = simulated(model, states, self._chosen)
        self.memories = Memories.of(model, states, actions, limits)
        self._kinds = dict[bytes, tuple[Floats, NDArray[np.int32]]]()

    def observe(self, action: int, samples: Array) -> None:
        """Nothing: rewards are computed for the decisions at which they differ."""

    def at(self, decision: int) -> tuple[Floats, NDArray[np.int32]]:
        """Rewards (A, M, S) over the method's scale, and the numbers of the next memories (A, M, S)."""
        paid, then = self._pay(self._probes, self._chosen, decision)
        kind = paid.tobytes() + then.tobytes()
        if kind not in self._kinds:
            if len(self._kinds) == CACHED:
                self._kinds.pop(next(iter(self._kinds)))
            self._kinds[kind] = self._all(decision)
        return self._kinds[kind]

    def _all(self, decision: int) -> tuple[Floats, NDArray[np.int32]]:
        shape = len(self._actions), len(self.memories), self._grid.size
        paid, then = np.empty(shape, np.float32), np.empty(shape, np.int32)
        for a, vector in enumerate(self._actions.vectors):
            vectors = np.tile(vector, (self._grid.size, 1))
            _, samples = simulated(self._model, self._grid.points, vectors)
            paid[a], then[a] = self._pay(samples, vectors, decision)
        refuse_nan(paid)
        return paid, then

    def _pay(self, samples: Array, vectors: Array, decision: int) -> tuple[Floats, NDArray[np.int32]]:
        """For samples (H + 1, N, k) of held actions (N, axes): rewards and next memories, (M, N)."""
        method, rows = self._model.method, samples.shape[1]
        t = np.full(rows, decision * self._model.hold)
        paid, then = np.empty((len(self.memories), rows), np.float32), np.empty((len(self.memories), rows), np.int32)
        for m, memory in enumerate(self.memories.values):
            rewards, after = method.along(samples, vectors, t, np.tile(memory, (rows, 1)))
            paid[m], then[m] = rewards.mean(axis=0) / method.scale, self.memories.numbers(after)
        return paid, then
