"""What an agent makes: policies of what is observed, or of the whole state. Import them from `stlbench.contract`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np

from stlbench.contract.arrays import Array, Arrays, Integers


class Policy(ABC):
    """A trained policy, frozen: later training does not change it."""

    @abstractmethod
    def act(self, observation: Array) -> Integers | Array:
        """The greedy actions, without any randomness: (N, D) -> indices (N,), or vectors (N, axes)."""

    def arrays(self) -> Arrays | None:
        """All that `Agent.restore` makes the same policy of, a few megabytes at most. None where it cannot be kept.

        A policy without them, as by default, is scored like any other, and gone when its cell ends.
        """
        return None

    def onnx(self) -> bytes | None:
        """The policy as an ONNX model, for other programs; None, as by default, where it has no such form.

        Its input is `observation`, float32 (N, D). Its output is what `act` returns: `index`, int64 (N,), of a grid, or
        `action`, float64 (N, axes). Raises `Unsuitable` where a library is not installed.
        """
        return None


class StatePolicy(ABC):
    """A policy that acts on the whole state, such as a planner's. Frozen, like every policy.

    It sees more than a learned policy does, so tables say which agent it comes from.
    """

    @abstractmethod
    def episode(self) -> Callable[[Array, Integers, Array], Integers | Array]:
        """What acts in one batch of episodes, from their starts on.

        It is called at every decision with the states (N, n), their steps t (N,) and the method's memory (N, m), and
        returns actions: indices (N,) of a grid, or vectors (N, axes). It may remember what happened in its episodes.
        """

    def value(self, state: Array) -> Array:
        """What it expects of episodes from the states (N, n) at step 0: (N,), in the unit of what it maximises.

        Of a robustness, the referee's score is what was reached: the two bracket what is possible. NaN by default.
        """
        return np.full(len(state), np.nan)
