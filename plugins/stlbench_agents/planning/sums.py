"""Backward induction: the greatest discounted sum of rewards, from every state of a grid at every decision."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stlbench.contract import Array, End, Integers, Model, StatePolicy
from stlbench_agents.planning.grid import Floats, Grid, Places
from stlbench_agents.planning.loops import pay_best
from stlbench_agents.planning.moves import ActionSet, refuse_beyond, simulated, sweep
from stlbench_agents.planning.rewards import CACHED, MOST_SIGNALS, USUAL, Arrivals, Limits, Memories, Transitions

LOST = -1e4  # the value of a state outside the grid, in units of the method's scale
_TIES = 1e-6  # of two actions whose returns differ by less, relative to their size, the smaller one is taken
_SETTLED, _ROUNDS = 1e-5, 2000
"""The value of such a decision is known at this change in a round, or after so many rounds."""


@dataclass(frozen=True)
class SumPolicy(StatePolicy):
    """One look ahead on the true system, with the values of the grid for what comes then."""

    model: Model
    grid: Grid
    actions: ActionSet
    memories: Memories
    later: Floats  # (decisions, M, S): what states are worth after each decision, over the method's scale, less `shift`
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
        if model.method.can_end:
            later[model.method.over(after)] = -self.shift[decision]
        returns = rewards.mean(axis=0) / model.method.scale + self.gamma * later
        returns[later == LOST] = LOST
        for end in reversed(model.ends):
            active = end.active[decision * model.hold + 1 : (decision + 1) * model.hold + 1]
            over = (end.over(samples[1:]) & active[:, None]).any(axis=0)
            paid = worth(model, end, self.gamma, model.steps // model.hold - decision)
            returns[over] = paid - self.gamma * self.shift[decision]
        by_action: Array = returns.reshape(count, rows)
        return by_action


def plan(model: Model, grid: Grid, actions: ActionSet, gamma: float, limits: Limits = USUAL) -> SumPolicy:
    """Solve for the method's rewards by the rules of the task's training episodes.

    At a cut the return goes on as if the last decision repeated for ever; without a discount it stops. Nothing is paid
    after a memory that is over. Raises `Unsuitable` where the method's memory takes too many values.
    """
    tabled = model.method.paid_on_arrival and len(model.method.specification.signals) <= MOST_SIGNALS
    rewards = Arrivals(model, grid, actions) if tabled else Transitions(model, grid, actions, limits)
    if (values := len(rewards.memories)) > 1:
        numbers = values * (model.steps // model.hold + CACHED * 2 * len(actions))
        what = f"a grid of {grid} points with {values} values of the method's memory"
        refuse_beyond(4e-9 * grid.size * numbers, what)
    ends = Ends(model, grid, actions, gamma)
    next_ = sweep(model, grid, actions, (rewards.observe, ends.observe))
    decisions = model.steps // model.hold
    later = np.zeros((decisions, len(rewards.memories), grid.size), np.float32)
    shift, moved = np.zeros(decisions), 0.0
    value = np.zeros(later.shape[1:], np.float32)
    over = _over(model, rewards.memories)
    for d in reversed(range(decisions)):
        paid, memory = rewards.at(d)
        step = _Step(grid, next_, paid, memory, ends.at(d), gamma)
        if (d + 1) * model.hold in model.cuts and d + 1 < decisions:
            value, moved = _settled(step, value) if gamma < 1 else np.zeros_like(value), 0.0
        later[d], shift[d] = value, moved
        step.back(later[d], shift[d], value)
        value[over] = -gamma * shift[d]
        moved = _recentre(value, gamma * shift[d])
    return SumPolicy(model, grid, actions, rewards.memories, later, shift, gamma)


def _over(model: Model, memories: Memories) -> Integers:
    """The numbers of the memories after which nothing is paid: worth 0 wherever the state goes."""
    return np.flatnonzero(model.method.over(memories.values)) if model.method.can_end else np.empty(0, np.int64)


@dataclass(frozen=True)
class _Step:
    grid: Grid
    next: Places
    paid: Floats
    memory: Floats
    ended: Floats
    gamma: float

    def back(self, later: Floats, shift: float, into: Floats) -> None:
        """From values later (M, S), less `shift`, to those before the decision, less gamma times `shift`."""
        ended = self.ended - np.float32(self.gamma * shift) if self.ended.size else self.ended
        pay_best(later, *self.next, self.grid.strides, self.paid, self.memory, ended, self.gamma, LOST, into)


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


class Ends:
    """Where the task's training episodes end early."""

    def __init__(self, model: Model, grid: Grid, actions: ActionSet, gamma: float) -> None:
        self._model, self._gamma = model, gamma
        shape = len(model.ends), len(actions), grid.size, model.hold
        self._over = np.empty(shape, np.bool_)
        self._pattern, self._values = b"", np.empty((0, 0), np.float32)

    def observe(self, action: int, samples: Array) -> None:
        for i, end in enumerate(self._model.ends):
            self._over[i, action] = end.over(samples[1:]).T

    def at(self, decision: int) -> Floats:
        """The whole return (A, S) of decisions that end the episode, NaN for others; empty where none does."""
        hold = self._model.hold
        left = self._model.steps // hold - decision
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
