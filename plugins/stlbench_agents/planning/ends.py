"""What a decision is worth that ends an episode, tabled for each action from each state."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array, End, Model
from stlbench_agents.planning.grid import Floats, Grid
from stlbench_agents.planning.moves import ActionSet


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

    def see(self, action: int, samples: Array) -> None:
        """Note at which of the samples (H + 1, S, k) an episode may end."""
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
