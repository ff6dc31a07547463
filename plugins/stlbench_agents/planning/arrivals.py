"""Rewards that are paid for samples alone, tabled on a grid of the signals: one table a step, whatever the actions."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array, Model
from stlbench_agents.planning.axes import Axis
from stlbench_agents.planning.grid import Floats, Grid, Places
from stlbench_agents.planning.kernels import mean_rewards
from stlbench_agents.planning.memories import Memories
from stlbench_agents.planning.moves import ActionSet

MOST_SIGNALS = 4
"""The most dimensions of a grid, and so of one of signals."""

_CELLS = 150_000
"""About the most points of the grid of signals."""


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

    def see(self, action: int, samples: Array) -> None:
        """Note the places of samples (H + 1, S, k)."""
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
        axes.append(_open(grid.axes[same[0]]) if same else _even(signals[:, j], int(_CELLS ** (1 / count))))
    points = float(np.prod([len(axis) for axis in axes]))
    finer = max(1, int((_CELLS / points) ** (1 / count)))
    return Grid(tuple(axis.finer(finer) for axis in axes))


def _open(axis: Axis) -> Axis:
    """Without a period, which a signal need not have."""
    return Axis(axis.points)


def _even(values: Array, points: int) -> Axis:
    low, high = values.min(), values.max()
    return Axis(np.linspace(low, high if high > low else low + 1, points))
