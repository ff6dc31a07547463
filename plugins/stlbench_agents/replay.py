"""A ring of transitions of N copies in lock-step, sampled as n-step returns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stlbench.contract import Array, Integers, Transition

__all__ = ["Batch", "Replay"]

Single = NDArray[np.float32]


class Batch(NamedTuple):
    """B sampled transitions of up to n decisions."""

    observation: Single
    """(B, D), x_t."""
    action: Integers
    """(B,), a_t."""
    returns: Single
    """(B,), r_t + gamma r_{t+1} + ... up to n rewards, fewer where the episode ended."""
    arrived: Single
    """(B, D), what to bootstrap from."""
    discount: Single
    """(B,), gamma to the number of rewards in `returns`: the weight of the bootstrap value."""
    ended: NDArray[np.bool_]
    """(B,), whether `arrived` is the end of its episode."""


class Replay:
    """The last `rows` lock-steps of `copies` environments: about rows * copies transitions."""

    def __init__(self, rows: int, copies: int, size: int, n_steps: int, gamma: float) -> None:
        """Args: `size` D; `n_steps` n; `gamma` the discount a decision."""
        self._observation = np.zeros((rows * copies, size), dtype=np.float32)
        self._arrived = np.zeros((rows * copies, size), dtype=np.float32)
        self._action = np.zeros(rows * copies, dtype=np.int64)
        self._reward = np.zeros(rows * copies, dtype=np.float32)
        self._ended = np.zeros(rows * copies, dtype=np.bool_)
        self._rows, self._copies, self._n = rows, copies, n_steps
        self._powers = (gamma ** np.arange(n_steps + 1)).astype(np.float32)
        self.count = 0

    def add(self, observation: Array, action: Integers, transition: Transition) -> None:
        """Store one lock-step: what was seen (N, D), what was done (N,), what came of it."""
        begin = self.count % self._rows * self._copies
        row = slice(begin, begin + self._copies)
        self._observation[row], self._action[row] = observation, action
        self._reward[row], self._arrived[row] = transition.reward, transition.arrived
        self._ended[row] = transition.ended
        self.count += 1

    @property
    def ready(self) -> bool:
        """Whether there are n consecutive lock-steps to sample from."""
        return self.count >= self._n

    def sample(self, generator: np.random.Generator, batch: int) -> Batch:
        """Draw `batch` transitions uniformly, with replacement."""
        stored = min(self.count, self._rows)
        oldest = self.count % self._rows if self.count > self._rows else 0
        draw = generator.integers((stored - self._n + 1) * self._copies, size=batch)
        first = (draw + oldest * self._copies) % len(self._reward)
        returns, last, discount = _returns(first, self._copies, self._powers, self._reward, self._ended)
        return Batch(
            self._observation.take(first, axis=0),
            self._action.take(first),
            returns,
            self._arrived.take(last, axis=0),
            discount,
            self._ended.take(last),
        )


@njit(cache=True)
def _returns(
    first: Integers, copies: int, powers: Single, reward: Single, ended: NDArray[np.bool_]
) -> tuple[Single, Integers, Single]:
    """From each of the transitions `first`: the return, the last transition that counts, the discount after it."""
    returns, last, discount = np.empty(len(first), np.float32), first.copy(), np.empty(len(first), np.float32)
    for i in range(len(first)):
        total, taken = powers.dtype.type(0), 0
        while True:
            total += powers[taken] * reward[last[i]]
            taken += 1
            if taken == len(powers) - 1 or ended[last[i]]:
                break
            last[i] = (last[i] + copies) % len(reward)
        returns[i], discount[i] = total, powers[taken]
    return returns, last, discount
