"""The values that a method's memory takes, found by trying, and their numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import Array, Model, Unsuitable
from stlbench_agents.planning.moves import ActionSet, held

__all__ = ["MOST", "Memories"]

MOST = 64
"""The most values of a memory that are planned with."""


@dataclass(frozen=True)
class Memories:
    """Each value that a memory takes, a row; of a method without memory there is one, which is empty."""

    values: Array
    """(M, m)."""

    def __len__(self) -> int:
        return len(self.values)

    @classmethod
    def none(cls) -> Memories:
        """Of a method without memory."""
        return cls(np.empty((1, 0)))

    @classmethod
    def of(cls, model: Model, probes: Array, actions: ActionSet) -> Memories:
        """All that the method's memory becomes from the states `probes` (N, n) by random actions, at any decision.

        Raises:
            Unsuitable: they are more than 64.
        """
        method = model.method
        if not method.memory_size:
            return cls.none()
        chosen = actions.vectors[np.random.default_rng(0).integers(len(actions), size=len(probes))]
        _, samples = held(model, probes, chosen)
        first = np.concatenate([model.system.signals(model.starts), samples[0]])
        known = _distinct(method.initial_memory(first, np.zeros(len(first), dtype=np.int64)))
        for t in range(0, model.steps, model.hold):
            times = np.full(len(probes), t)
            then = [method.along(samples, chosen, times, np.tile(row, (len(probes), 1)))[1] for row in known]
            known = _distinct(np.concatenate([known, *map(_distinct, then)]))
        return cls(known)

    def numbers(self, memory: Array) -> NDArray[np.int32]:
        """The number of the value that each row (N, m) is; of one that was not found, of one near it."""
        if len(self) == 1:
            return np.zeros(len(memory), dtype=np.int32)
        direction = np.random.default_rng(0).random(self.values.shape[1]) + 0.5  # tells all values apart
        keys, asked = self.values @ direction, memory @ direction
        order = np.argsort(keys)
        ascending = keys[order]
        right = np.clip(np.searchsorted(ascending, asked), 1, len(self) - 1)
        nearer = np.where(asked - ascending[right - 1] <= ascending[right] - asked, right - 1, right)
        numbers: NDArray[np.int32] = order[nearer].astype(np.int32)
        return numbers


def _distinct(memory: Array) -> Array:
    """Each row once. Refuses more than can be planned with."""
    distinct = np.unique(memory, axis=0)
    if len(distinct) > MOST:
        raise Unsuitable(
            f"a memory of {memory.shape[1]} numbers that takes more than {MOST} values; a planner enumerates them"
        )
    return distinct
