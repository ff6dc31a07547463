"""Rewards of transitions, and what becomes of a method's memory: asked of the method for each action from each state.

That is dear, so it is done once for all decisions at which the method pays alike, and that is tried on some thousands
of transitions.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import Array, Model
from stlbench_agents.planning.arrivals import refuse_nan
from stlbench_agents.planning.grid import Floats, Grid
from stlbench_agents.planning.memories import Limits, Memories
from stlbench_agents.planning.moves import ActionSet, held

_PROBES = 4096
"""States, each with a random action, by which decisions are told apart."""
KEPT = 2
"""Tables of rewards that are kept at a time."""


class Transitions:
    """The rewards of any method, for each action from each state at a decision, and its next memories."""

    def __init__(self, model: Model, grid: Grid, actions: ActionSet, limits: Limits) -> None:
        generator = np.random.default_rng(1)
        self._model, self._grid, self._actions = model, grid, actions
        states = grid.points[generator.integers(grid.size, size=_PROBES)]
        self._chosen = actions.vectors[generator.integers(len(actions), size=_PROBES)]
        _, self._probes = held(model, states, self._chosen)
        self.memories = Memories.of(model, states, actions, limits)
        self._kinds = dict[bytes, tuple[Floats, NDArray[np.int32]]]()

    def see(self, action: int, samples: Array) -> None:
        """Nothing: rewards are asked for when they are known to differ."""

    def at(self, decision: int) -> tuple[Floats, NDArray[np.int32]]:
        """Rewards (A, M, S) over the method's scale, and the numbers of the next memories (A, M, S)."""
        paid, then = self._pay(self._probes, self._chosen, decision)
        kind = paid.tobytes() + then.tobytes()
        if kind not in self._kinds:
            if len(self._kinds) == KEPT:
                self._kinds.pop(next(iter(self._kinds)))
            self._kinds[kind] = self._all(decision)
        return self._kinds[kind]

    def _all(self, decision: int) -> tuple[Floats, NDArray[np.int32]]:
        shape = len(self._actions), len(self.memories), self._grid.size
        paid, then = np.empty(shape, np.float32), np.empty(shape, np.int32)
        for a, vector in enumerate(self._actions.vectors):
            vectors = np.tile(vector, (self._grid.size, 1))
            _, samples = held(self._model, self._grid.points, vectors)
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
