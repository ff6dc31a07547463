"""The values that a method's memory takes, found by trying, and their numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import Array, Model, Unsuitable
from stlbench_agents.planning.moves import ActionSet, held


@dataclass(frozen=True)
class Limits:
    """How many values of a memory are planned with; see the parameters of `planner`."""

    values: int = 64
    """The most that are enumerated."""
    rounded: int = 0
    """To how many a memory of one number is rounded that takes more; 0: such a memory is refused."""

    def rounds(self, distinct: Array) -> bool:
        """Whether these values (M, m) of a memory must be rounded.

        Raises:
            Unsuitable: they must be and cannot.
        """
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

    values: Array
    """(M, m)."""

    def __len__(self) -> int:
        return len(self.values)

    @classmethod
    def none(cls) -> Memories:
        """Of a method without memory."""
        return cls(np.empty((1, 0)))

    @classmethod
    def of(cls, model: Model, probes: Array, actions: ActionSet, limits: Limits) -> Memories:
        """All that the method's memory becomes from the states `probes` (N, n) by random actions, at any decision.

        Raises:
            Unsuitable: they are more than `limits` allows.
        """
        method = model.method
        if not method.memory_size:
            return cls.none()
        chosen = actions.vectors[np.random.default_rng(0).integers(len(actions), size=len(probes))]
        _, samples = held(model, probes, chosen)
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
