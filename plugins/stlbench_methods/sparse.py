"""sparse: whether the formula holds, paid once at the end; what every other method tries to improve on."""

from __future__ import annotations

from typing import Literal

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Integers, RewardMethod, Specification, Truth, Unsuitable
from stlbench_methods.flag import AbsoluteFlags
from stlbench_methods.progress import Progress
from stlbench_methods.values import Truths


class Sparse(RewardMethod):
    """1 at the last transition of an episode that satisfies the formula, else 0.

    The verdict is the Boolean one, which the referee uses too, and not the sign of the robustness.

    The policy sees how far the formula is. In the fragment of eq. 2 that is one flag for F psi and for G psi, and for
    F[a,c1] G[c2,b] psi a flag and a count of samples of psi in a row. Outside the fragment it is a running verdict for
    each outer F and G, and the last truths of what looks ahead inside it.

    Args:
        pays: `success`, as above; `failure`, -1 where the formula does not hold, else 0.

    Raises:
        Unsuitable: an operator looks back.
    """

    def __init__(self, specification: Specification, *, pays: Literal["success", "failure"] = "success") -> None:
        super().__init__(specification)
        self._offset = 0.0 if pays == "success" else -1.0
        self._verdict: _Verdict
        try:
            self._verdict = _ByFlags(specification)
        except Unsuitable:
            self._verdict = _ByProgress(specification)
        self.memory_size = self._verdict.size

    @property
    def input_size(self) -> int:
        return self._verdict.input_size

    @property
    def floor(self) -> float:
        return self._offset

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        return self._verdict.begin(signals, t)

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        memory = self._verdict.after(samples[1:], t + 1, memory)
        rewards, end = np.zeros((len(samples) - 1, len(t))), t + len(samples) - 1
        if (over := end == self.specification.steps).any():
            rewards[-1, over] = self._verdict.satisfied(memory[over], end[over]) + self._offset
        return rewards, memory

    def inputs(self, memory: Array) -> Array:
        return self._verdict.inputs(memory)


class _ByFlags:
    """The flags of the method `flag`, by absolute intervals."""

    def __init__(self, specification: Specification) -> None:
        self._flags = AbsoluteFlags(specification, 1.0)
        self.size = self.input_size = len(self._flags.full)

    def begin(self, signals: Array, t: Integers) -> Array:
        return self._flags.along(signals[None], t, np.tile(self._flags.initial, (len(signals), 1)))[1]

    def after(self, samples: Array, t: Integers, memory: Array) -> Array:
        return self._flags.along(samples, t, memory)[1]

    def satisfied(self, memory: Array, t: Integers) -> Truth:
        held: Truth = (memory[:, self._flags.columns] == 1).all(axis=1)
        return held

    def inputs(self, memory: Array) -> Array:
        return memory / self._flags.full


class _ByProgress:
    """Any other formula."""

    def __init__(self, specification: Specification) -> None:
        self._progress = Progress(specification, Truths(specification, stl.semantics("classic")))
        self.size, self.input_size = self._progress.size, self._progress.input_size

    def begin(self, signals: Array, t: Integers) -> Array:
        return self._progress.begin(signals, t)

    def after(self, samples: Array, t: Integers, memory: Array) -> Array:
        return self._progress.along(samples, t, memory)[-1]

    def satisfied(self, memory: Array, t: Integers) -> Truth:
        return self._progress.so_far(memory, t) > 0.5

    def inputs(self, memory: Array) -> Array:
        return self._progress.inputs(memory)


_Verdict = _ByFlags | _ByProgress
