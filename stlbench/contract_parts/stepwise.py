"""How `step` and `along` of a reward method follow from each other; `stlbench.contract` says what they are."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["along_by_steps", "complete"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
_EITHER = ("step", "along")


class Stepping(Protocol):
    """A reward method, as far as it matters here."""

    memory_size: int

    def step(
        self, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array
    ) -> tuple[Array, Array]:
        """See `stlbench.contract.RewardMethod.step`."""


def complete(kind: type, base: type) -> None:
    """Let the one of `step` and `along` that a subclass of `base` does not write be that of `base`.

    What a class between the two has written is another reward. Raises `TypeError` for a class with both or neither.
    """
    written = [name for name in _EITHER if name in vars(kind)]
    if len(written) == 1:
        (other,) = set(_EITHER) - set(written)
        setattr(kind, other, getattr(base, other))
    elif written or all(getattr(kind, name) is getattr(base, name) for name in _EITHER):
        raise TypeError(f"{kind.__name__} has {'both' if written else 'neither'} of step and along; write one of them")


def along_by_steps(method: Stepping, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
    """What `along` gives, by `step` after `step`; in one call where no step depends on the one before."""
    held, rows, k = len(samples) - 1, len(t), samples.shape[2]
    if held > 1 and not method.memory_size:
        before, after = samples[:-1].reshape(-1, k), samples[1:].reshape(-1, k)
        times = (t + np.arange(held)[:, None]).ravel()
        reward, _ = method.step(before, np.tile(action, (held, 1)), after, times, np.zeros((len(times), 0)))
        return reward.reshape(held, rows), memory
    rewards = np.empty((held, rows))
    for i in range(held):
        rewards[i], memory = method.step(samples[i], action, samples[i + 1], t + i, memory)
    return rewards, memory
