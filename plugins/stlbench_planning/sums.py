"""Backward induction: the greatest discounted sum of rewards, from every state of a grid at every decision."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import Array, End, Integers, Model, StatePolicy, Unsuitable
from stlbench_planning.grid import ActionSet, Axis, Floats, Grid, Places, refuse_beyond, simulated, sweep
from stlbench_planning.loops import mean_rewards, pay_best


@dataclass(frozen=True)
class Limits:
    values: int = 64  # the most that are enumerated
    rounded: int = 0  # a memory of one number that takes more is rounded to this many values; 0: it is refused

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
    """Each value that a memory takes, a row; a method without memory has one, which is empty."""

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


LOST = -1e4
"""The value of a state outside the grid, in units of the method's scale. It is no infinity, as interpolation next to
such a state would make NaN of 0 times that."""
_TIES = 1e-6
"""Returns that differ by less, relative to their size, are equal: rounding would else choose the action."""
_SETTLED, _ROUNDS = 1e-5, 2000
"""The value of a decision that repeats for ever is known at this change in a round, or after this many rounds."""


@dataclass(frozen=True)
class SumPolicy(StatePolicy):
    """One look ahead on the true system, with the values of the grid for what comes then."""

    model: Model
    grid: Grid
    actions: ActionSet
    memories: Memories
    later: Floats  # (decisions, M, S): values of states after each decision, over the method's scale, less `shift`
    shift: Array  # (decisions,)
    gamma: float

    def episode(self) -> Callable[[Array, Integers, Array], Integers | Array]:
        return self._act

    def value(self, state: Array) -> Array:
        """The expected discounted sum of rewards, in the method's unit."""
        signals, t = self.model.system.signals(state), np.zeros(len(state), dtype=np.int64)
        returns = self._returns(state, 0, self.model.method.initial_memory(signals, t)).max(axis=0)
        expected: Array = (returns + self.gamma * self.shift[0]) * self.model.method.scale
        return expected

    def _act(self, state: Array, t: Integers, memory: Array) -> Integers | Array:
        chosen = np.empty(len(state), dtype=np.int64)
        for step in np.unique(t):
            rows = t == step
            returns = self._returns(state[rows], int(step) // self.model.hold, memory[rows])
            best = returns.max(axis=0)
            chosen[rows] = (returns >= best - _TIES * (1 + np.abs(best))).argmax(axis=0)
        choices: Integers | Array = self.actions.choices[chosen]
        return choices

    def _returns(self, state: Array, decision: int, memory: Array) -> Array:
        model, count, rows = self.model, len(self.actions), len(state)
        vectors = np.repeat(self.actions.vectors, rows, axis=0)
        path, samples = simulated(model, np.tile(state, (count, 1)), vectors)
        t = np.full(count * rows, decision * model.hold)
        rewards, after = model.method.along(samples, vectors, t, np.tile(memory, (count, 1)))
        numbers, later = self.memories.numbers(after), np.empty(count * rows)
        for m in np.unique(numbers):
            here = numbers == m
            later[here] = self.grid.read(self.later[decision, m], path[-1, here], LOST)
        if model.method.can_end:  # nothing more is paid: the value 0, less the shift
            later[model.method.over(after)] = -self.shift[decision]
        returns = rewards.mean(axis=0) / model.method.scale + self.gamma * later
        returns[later == LOST] = LOST
        for end in reversed(model.ends):  # the first of two ends at one decision counts, so it writes last
            active = end.active[decision * model.hold + 1 : (decision + 1) * model.hold + 1]
            over = (end.over(samples[1:]) & active[:, None]).any(axis=0)
            paid = worth(model, end, self.gamma, model.decisions - decision)
            returns[over] = paid - self.gamma * self.shift[decision]
        by_action: Array = returns.reshape(count, rows)
        return by_action


def plan(model: Model, grid: Grid, actions: ActionSet, gamma: float, limits: Limits = USUAL) -> SumPolicy:
    """Solve for the method's rewards by the rules of the task's training episodes.

    At a cut the return goes on as if the last decision repeated for ever; without a discount it stops. Nothing is paid
    after a memory that is over. Raises `Unsuitable` if the method's memory takes too many values.
    """
    tabled = model.method.paid_on_arrival and len(model.method.specification.signals) <= MOST_SIGNALS
    rewards = Arrivals(model, grid, actions) if tabled else Transitions(model, grid, actions, limits)
    if (values := len(rewards.memories)) > 1:
        numbers = values * (model.decisions + CACHED * 2 * len(actions))
        what = f"a grid of {grid} points with {values} values of the method's memory"
        refuse_beyond(4e-9 * grid.size * numbers, what)
    ends = EndReturns(model, grid, actions, gamma)
    next_ = sweep(model, grid, actions, (rewards.observe, ends.observe))
    decisions = model.decisions
    later = np.zeros((decisions, len(rewards.memories), grid.size), np.float32)
    shift, moved = np.zeros(decisions), 0.0
    value = np.zeros(later.shape[1:], np.float32)
    over = _over(model, rewards.memories)
    ended = ~np.isnan(over)
    for d in reversed(range(decisions)):
        paid, memory = rewards.at(d)
        step = _Step(grid, next_, paid, memory, ends.at(d), over, gamma)
        if (d + 1) * model.hold in model.cuts and d + 1 < decisions:
            value, moved = _settled(step, value) if gamma < 1 else np.zeros_like(value), 0.0
        later[d], shift[d] = value, moved
        step.back(later[d], shift[d], value)
        value[ended] = -gamma * shift[d]
        moved = _recentre(value, gamma * shift[d])
    return SumPolicy(model, grid, actions, rewards.memories, later, shift, gamma)


def _over(model: Model, memories: Memories) -> Floats:
    """(M,): 0 for a memory after which nothing is paid, wherever the state goes; NaN for any other."""
    over = model.method.over(memories.values) if model.method.can_end else np.zeros(len(memories), np.bool_)
    return np.where(over, 0.0, np.nan).astype(np.float32)


@dataclass(frozen=True)
class _Step:
    grid: Grid
    next: Places
    paid: Floats
    memory: Floats
    ended: Floats
    over: Floats
    gamma: float

    def back(self, later: Floats, shift: float, into: Floats) -> None:
        """Values before the decision, less gamma times `shift`, from those later (M, S), less `shift`."""
        ended = self.ended - np.float32(self.gamma * shift) if self.ended.size else self.ended
        over = self.over - np.float32(shift)
        pay_best(later, *self.next, self.grid.strides, self.paid, self.memory, ended, over, self.gamma, LOST, into)


def _settled(step: _Step, value: Floats) -> Floats:
    later = np.zeros_like(value)
    for _ in range(_ROUNDS):
        step.back(later, 0.0, value)
        change = float(np.abs(value - later).max())
        later[:] = value
        if change < _SETTLED:
            break
    if step.gamma**_ROUNDS > _SETTLED:  # so near 1, the next round tells the sum of all further ones
        step.back(later, 0.0, value)
        later += (value - later) / np.float32(1 - step.gamma)
    return later


def _recentre(value: Floats, shift: float) -> float:
    """Move values so that the greatest is 0, which keeps their differences exact in 32 bits; the whole shift so far."""
    top = float(value.max())
    alive = value > LOST
    value[alive] -= np.float32(top)
    return shift + top


def worth(model: Model, end: End, gamma: float, decisions: int) -> float:
    """The return of an end's reward, which is paid for ever, and by a method that can end once."""
    return end.reward if model.method.can_end else forever(end.reward, gamma, decisions)


def forever(reward: float, gamma: float, decisions: int) -> float:
    """The return of a reward that is paid for ever; without a discount, for the decisions that are left."""
    return reward / (1 - gamma) if gamma < 1 else reward * decisions


class EndReturns:
    """The returns of decisions at which the task's training episodes end early."""

    def __init__(self, model: Model, grid: Grid, actions: ActionSet, gamma: float) -> None:
        self._model, self._gamma = model, gamma
        shape = len(model.ends), len(actions), grid.size, model.hold
        self._over = np.empty(shape, np.bool_)
        self._pattern, self._values = b"", np.empty((0, 0), np.float32)

    def observe(self, action: int, samples: Array) -> None:
        for i, end in enumerate(self._model.ends):
            self._over[i, action] = end.over(samples[1:]).T

    def at(self, decision: int) -> Floats:
        """The whole return (A, S) of decisions that end the episode, NaN for others; empty if none does."""
        hold = self._model.hold
        left = self._model.decisions - decision
        active = [end.active[decision * hold + 1 : (decision + 1) * hold + 1] for end in self._model.ends]
        returns = [worth(self._model, end, self._gamma, left) for end in self._model.ends]
        pattern = np.concatenate([*active, np.array(returns)]).tobytes() if active else b""
        if pattern != self._pattern:
            self._pattern, self._values = pattern, self._table(active, returns)
        return self._values

    def _table(self, active: list[Floats], returns: list[float]) -> Floats:
        table = np.full(self._over.shape[1:3], np.nan, np.float32)
        for over, now, paid in zip(self._over[::-1], reversed(active), reversed(returns), strict=True):
            if now.any():
                table[over[:, :, now].any(axis=2)] = paid
        return table
