"""What the simulator drives: N copies of what is controlled. Import it from `stlbench.contract`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

_Array = NDArray[np.float64]
_Integers = NDArray[np.int64]


class World(ABC):
    """N copies of what is controlled, in lock-step, each in an episode of its own.

    A `System` is one kind of it, an environment of Gymnasium another; a task of the kind `WorldTask` brings its own,
    such as a simulation in C++ or on a graphics card. Agents, methods and the referee do not know which.

    A copy begins where its start says. Of a system that is a state; of every other world it is a seed, a whole number:
    the same seed and the same actions give the same episode, whatever the copy did before.
    """

    can_end: ClassVar[bool] = True
    """Whether a copy can end by itself. Where it cannot, `ended` is not asked for."""
    signals: _Array
    """(N, k): the newest sample of each copy, in the order of the task file's `signals`."""
    ended: NDArray[np.bool_]
    """(N,): the copies that have ended by themselves. They stand still: their last sample stays."""
    lived: _Integers
    """(N,): the steps that each copy has made since its start, without those in which it stood still."""

    @abstractmethod
    def restart(self, rows: _Integers, starts: _Array) -> None:
        """Begin new episodes in the rows (r,), at the starts (r, s); s is 1 for seeds. All rows begin before a step."""

    @abstractmethod
    def advance(self, action: _Array, steps: int) -> _Array:
        """Hold the actions (N, axes) for so many steps.

        Returns:
            The samples before and after each step, (steps + 1, N, k); the last of them is `signals` then.
        """

    @abstractmethod
    def features(self, t: _Integers) -> _Array:
        """What the policy sees of each copy, about in [-1, 1], if copies are at the steps t (N,): (N, d)."""

    @property
    def state(self) -> _Array:
        """The states (N, n) of the copies; (N, 0) where they cannot be read."""
        return np.empty((len(self.signals), 0))

    def frames(self) -> tuple[NDArray[np.uint8], ...] | None:
        """A picture of each copy, (height, width, 3), always of one size; None where the world has none of itself.

        Raises `RuntimeError`, in one line, where this machine lacks what it takes to draw.
        """
        return None

    def by_hand(self, t: _Integers) -> _Array | None:
        """What a controller written by hand does at steps t (N,): actions (N, axes); None where there is none.

        They are within their range; on a grid the nearest value of each axis is taken.
        """
        return None
