"""A ring of transitions of N copies in lock-step, read as n-step returns, and the weights of rewards."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import Array, Arrays, Event, Integers, Transition
from stlbench_agents.kernels import compiled, flattened, inlined
from stlbench_agents.layers import zeros

Single = NDArray[np.float32]

_STOP, _END = 1, 2  # a return stops after the transition: it bootstraps, or nothing follows
_KEPT, _NUMBERS = 50_000, 2**25
"""Transitions that a later training gets at most, 43 MB for 105 inputs; and numbers of their observations, 134 MB."""
_STORED = ("observation", "arrived", "action", "reward", "after")


class Batch(NamedTuple):
    """B transitions of up to n decisions."""

    observation: Single  # (B, D), x_t
    action: NDArray[Any]  # (B,), a_t, or (B, axes) if actions are vectors
    returns: Single  # (B,), r_t + gamma r_{t+1} + ... up to n rewards, fewer if the return stops
    arrived: Single  # (B, D), the observation to bootstrap from
    discount: Single
    """(B,), the weight of the bootstrap value: gamma to the number of rewards in `returns`, 0 if nothing follows."""
    bounds: Single  # (2,), as in `Memory`

    @staticmethod
    def of(rows: int, size: int, axes: int = 0) -> Batch:
        wide = (rows, size)
        return Batch(zeros(wide), _actions(rows, axes), *(zeros(part) for part in (rows, wide, rows, 2)))


@inlined
def bounded_target(batch: Batch, row: int, value: Any) -> Any:
    """The target of a row with this value to bootstrap from, kept within the bounds of values.

    Without bounds, values of states that were never visited run away.
    """
    return min(batch.bounds[1], max(batch.bounds[0], batch.returns[row] + batch.discount[row] * value))


class Memory(NamedTuple):
    """The stored transitions: that of lock-step i and copy c is row i * copies + c."""

    observation: Single
    arrived: Single
    action: NDArray[Any]
    reward: Single  # as `weighted_rewards` gives them
    after: NDArray[np.uint8]  # 0, `_STOP` or `_END`
    powers: Single  # (n + 1,), gamma^0 to gamma^n
    bounds: Single  # (2,), the least and the greatest value that the rewards allow


def _actions(rows: int, axes: int) -> NDArray[Any]:
    return np.zeros((rows, axes), np.float32) if axes else np.zeros(rows, np.int64)


def weighted_rewards(transition: Transition, gamma: float, weight: float = 1.0) -> Array:
    """The rewards (N,), times `weight`; at an `Event.END` times 1 / (1 - gamma) too, as if paid for ever.

    The sum would be infinite for gamma = 1: the reward then counts once.
    """
    for_ever = weight if gamma == 1 else weight / (1 - gamma)
    weights: Array = np.where(transition.event == Event.END, for_ever, weight)
    return weights * transition.reward


class Replay:
    """The last `rows` lock-steps of `copies` environments: about rows * copies transitions.

    Rewards are weighted by 1 - gamma, so that a value keeps the scale of the rewards whatever gamma is. They are not
    for gamma = 1, as the weight would be 0.
    """

    def __init__(
        self,
        rows: int,
        copies: int,
        size: int,
        n_steps: int,
        gamma: float,
        scale: float = 1.0,
        limit: bool = False,
        axes: int = 0,
        bounded: bool = True,
    ) -> None:
        """Args: `limit` whether nothing is bootstrapped at the time limit; `axes` of vectors, 0 for indices; `bounded`
        whether values are. A value is a sum for gamma = 1, and has no bounds."""
        count = rows * copies
        # No value yet lies between the bounds: the first rewards set them. A time limit that is an end has the value 0.
        nothing = 0.0 if limit else -np.inf
        bounds = (-nothing, nothing) if bounded and gamma < 1 else (-np.inf, np.inf)
        self.memory = Memory(
            np.zeros((count, size), np.float32),
            np.zeros((count, size), np.float32),
            _actions(count, axes),
            np.zeros(count, np.float32),
            np.zeros(count, np.uint8),
            (gamma ** np.arange(n_steps + 1)).astype(np.float32),
            np.array(bounds, np.float32),
        )
        self._rows, self._copies, self._n, self._limit, self._axes = rows, copies, n_steps, limit, axes
        self._gamma, self._scale = gamma, scale
        self.count = 0

    def add(self, observation: Array, action: Integers | Array, transition: Transition) -> None:
        """Store one lock-step: observations (N, D), actions (N,) and transitions. A return stops where it is `cut`."""
        begin = self.count % self._rows * self._copies
        row, memory = slice(begin, begin + self._copies), self.memory
        memory.observation[row], memory.action[row] = observation, action
        memory.arrived[row] = transition.arrived
        memory.reward[row] = weighted_rewards(transition, self._gamma, self._scale * ((1 - self._gamma) or 1))
        self.widen(transition.reward)
        memory.after[row] = transition.cut
        memory.after[row][transition.event >= (Event.TIME_LIMIT if self._limit else Event.END)] = _END
        self.count += 1

    def widen(self, reward: Array) -> None:
        """Widen the bounds of values by rewards (N,): a value is a weighted mean of rewards."""
        rewards, bounds = reward.tolist(), self.memory.bounds  # faster than NumPy's minimum and maximum of few numbers
        bounds[0], bounds[1] = min(bounds[0], self._scale * min(rewards)), max(bounds[1], self._scale * max(rewards))

    def kept(self) -> Arrays:
        """The newest transitions, the oldest first, for `refill`."""
        most = min(_KEPT, _NUMBERS // (2 * self.memory.observation.shape[1]))
        rows = min(self.count, self._rows, most // self._copies)
        steps = np.arange(self.count - rows, self.count) % self._rows
        places = (steps[:, None] * self._copies + np.arange(self._copies)).ravel()
        kept = {name: getattr(self.memory, name)[places] for name in _STORED}
        return {**kept, "bounds": self.memory.bounds, "returns": self._returns}

    @property
    def _returns(self) -> Array:
        return np.array([self._copies, self._n, self._gamma, self._scale])

    def fits(self, kept: Arrays) -> bool:
        """Whether these `kept` transitions are of as many copies, and of the same returns and weights."""
        return bool((kept["returns"] == self._returns).all())

    def refill(self, kept: Arrays) -> None:
        """Begin with the transitions of another replay, which fit."""
        rows = min(len(kept["reward"]) // self._copies, self._rows)
        for name in _STORED:
            getattr(self.memory, name)[: rows * self._copies] = kept[name][-rows * self._copies :]
        last = self.memory.after[(rows - 1) * self._copies : rows * self._copies]
        last[last == 0] = _STOP  # no return goes on into another training
        self.memory.bounds[:] = kept["bounds"]
        self.count = rows

    @property
    def ready(self) -> bool:
        """Whether a return of n rewards can be drawn."""
        return self.count >= self._n

    def draw(self, generator: np.random.Generator, updates: int, batch: int) -> Integers:
        """Draw transitions uniformly, with replacement: their places in `memory`, (updates, batch)."""
        stored = min(self.count, self._rows)
        oldest = self.count % self._rows if self.count > self._rows else 0
        # The newest n - 1 lock-steps begin no return of n rewards: the ring goes on with the oldest ones after them.
        drawn: Integers = generator.integers((stored - self._n + 1) * self._copies, size=(updates, batch))
        if oldest:
            drawn += oldest * self._copies
            drawn %= len(self.memory.reward)
        return drawn

    def batch(self, first: Integers) -> Batch:
        """The transitions that begin at the places `first` (B,) of `memory`."""
        batch = Batch.of(len(first), self.memory.observation.shape[1], self._axes)
        gather(self.memory, first, self._copies, batch)
        return batch


@compiled
def gather(memory: Memory, first: Integers, copies: int, into: Batch) -> None:
    """Write the transitions of up to n decisions that begin at the places `first` (B,) into a batch of B rows."""
    reward, powers, size = memory.reward, memory.powers, memory.observation.shape[1]
    axes = memory.action.size // len(reward)
    seen, arrived, acted = flattened(memory.observation), flattened(memory.arrived), flattened(memory.action)
    into_seen, into_arrived, into_acted = flattened(into.observation), flattened(into.arrived), flattened(into.action)
    into.bounds[0], into.bounds[1] = memory.bounds[0], memory.bounds[1]
    for i in range(len(first)):
        begin = last = first[i]
        taken, total = 1, reward[begin]
        while taken < len(powers) - 1 and memory.after[last] == 0:
            last += copies
            if last >= len(reward):
                last -= len(reward)
            total += powers[taken] * reward[last]
            taken += 1
        into.returns[i], into.discount[i] = total, 0 if memory.after[last] == _END else powers[taken]
        for j in range(axes):
            into_acted[i * axes + j] = acted[begin * axes + j]
        for j in range(size):
            into_seen[i * size + j] = seen[begin * size + j]
            into_arrived[i * size + j] = arrived[last * size + j]
