"""How `arrival`, `step` and `along` of a reward method follow from each other; see `stlbench.contract`."""

from __future__ import annotations

from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from stlbench.contract.arrays import are_numbers

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
_ONE_OF = ("arrival", "step", "along")


class Stepping(Protocol):
    """A reward method, as far as it matters here."""

    memory_size: int
    paid_on_arrival: ClassVar[bool]

    def step(
        self, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array
    ) -> tuple[Array, Array]:
        """See `stlbench.contract.RewardMethod.step`."""


def complete(kind: type[Stepping], base: type[Stepping]) -> None:
    """Let those of `arrival`, `step` and `along` that a subclass of `base` does not write be those of `base`.

    What a class between the two has written is another reward. Raises `TypeError` for a class with none, or several.
    """
    written = [name for name in _ONE_OF if name in vars(kind)]
    if len(written) == 1:
        for other in set(_ONE_OF) - set(written):
            setattr(kind, other, getattr(base, other))
        kind.paid_on_arrival = written == ["arrival"]
    elif written or all(getattr(kind, name) is getattr(base, name) for name in _ONE_OF):
        found = " and ".join(written) or "none of them"
        raise TypeError(f"{kind.__name__} must have one of arrival, step and along, and has {found}")


def refuse_circle(method: Stepping, base: type[Stepping], name: str) -> None:
    """Raises `TypeError` where a class calls `super().step` in its `step`, say, and no class above has written one."""
    kind = type(method)
    if getattr(kind, name) is not getattr(base, name):
        raise TypeError(
            f"{kind.__name__}.{name} calls super().{name}, which would only call it again; call the one of arrival, "
            f"step and along that the class above has written"
        )


def along_by_steps(method: Stepping, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
    """What `along` gives, by `step` after `step`; in one call where no step depends on the one before."""
    held, rows, k = len(samples) - 1, len(t), samples.shape[2]
    if held > 1 and not method.memory_size:
        before, after = samples[:-1].reshape(-1, k), samples[1:].reshape(-1, k)
        times = (t + np.arange(held)[:, None]).ravel()
        reward, _ = method.step(before, np.tile(action, (held, 1)), after, times, np.zeros((len(times), 0)))
        return (reward.reshape(held, rows) if np.shape(reward) == times.shape else reward), memory
    rewards = []  # as they are: whoever asks checks their shape and type, which NumPy would change
    for i in range(held):
        reward, memory = method.step(samples[i], action, samples[i + 1], t + i, memory)
        rewards.append(reward)
        if not are_numbers(reward):
            return reward, memory
    return np.array(rewards, np.float64), memory
