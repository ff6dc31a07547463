"""counters: exact memory of one integer for each nested operator, and other counters to learn from."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from stlbench.contract import Array, Integers, RewardMethod, Specification, Truth
from stlbench_methods.counter_parts import DONE, FAILED, Answer, parts_of, tables_of
from stlbench_methods.formula_parts import truths


class Counters(RewardMethod):
    """Deadlines of nested operators, each as a count of samples.

    A chain F[a,b] (A & F[0,w] B) counts the time left after A. A response G[a,b] (A -> F[0,w] B) counts how long the
    oldest request waits. F[a,b] G[0,s] A counts how long A has held. A part is done, or has failed, as soon as no
    continuation changes that. So the verdict is the formula's. Parts are joined by `and`, as are the terms of eq. 2.

    If an episode of training begins later, the counters before it are those with the most time left.

    Args:
        pays: `margin`: the mean share of the parts at each sample. The share is the time left over the time to answer,
            or the stages of a chain that are reached; a part that is done has 1. `verdict`: 1 when all parts are
            done. Both pay -1 when one has failed, and nothing after it.
        counterfactuals: the number of times that each transition is learned from with other counters too, which could
            be there at its sample. Each is evenly drawn among those that the ones before it leave, part by part.

    Raises:
        Unsuitable: one counter for each operator does not decide the formula; the message names operator and place.
    """

    can_end = True
    floor = -1.0

    def __init__(
        self,
        specification: Specification,
        *,
        pays: Literal["margin", "verdict"] = "margin",
        counterfactuals: Annotated[int, Field(ge=0)] = 1,
    ) -> None:
        super().__init__(specification)
        self._parts = parts_of(specification.formula)
        self._tables, needed = tables_of(self._parts)
        self._holds = [specification.holds(need) for need in needed]
        self._margin = pays == "margin"
        self.counterfactuals = counterfactuals
        self.memory_size = len(self._tables.most)

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        from stlbench_methods.counter_kernels import begin

        memory = np.zeros((len(signals), self.memory_size))
        begin(self._tables, t, memory)
        return self._run(signals[None], t, memory)[1]

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        return self._run(samples[1:], t + 1, memory.copy())

    def inputs(self, memory: Array) -> Array:
        """The share of each count in its greatest; for an answer the time left, below 0 if a request is open.

        A part that is done ends with 1, one that has failed with -1.
        """
        share: Array = memory / np.maximum(self._tables.most, 1)
        state = memory[:, self._tables.last]
        for i, part in enumerate(self._parts):
            last = share[:, self._tables.last[i]]
            if isinstance(part, Answer):
                last[:] = 1 - last if part.request is None else np.where(last > 0, -last, 1)
            last[:] = np.select([state[:, i] == DONE, state[:, i] == FAILED], [1, -1], last)
        return share

    def over(self, memory: Array) -> Truth:
        state = memory[:, self._tables.last]
        over: Truth = (state == FAILED).any(axis=1)
        return over if self._margin else over | (state == DONE).all(axis=1)

    def counterfactual(self, signals: Array, t: Integers, memory: Array, chance: Array) -> Array:
        """Counters that some past leads to, if formulas may hold together; a part without any keeps its own."""
        from stlbench_methods.counter_kernels import draw

        other = memory.copy()
        draw(self._tables, truths(self._holds, signals[None])[:, 0], t, chance, other)
        return other

    def describe(self) -> Mapping[str, Any]:
        return {f"counter {i}": str(part) for i, part in enumerate(self._parts)}

    def _run(self, samples: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        """Samples (h, N, k), the first at steps t, and the memory before it, which is changed in place."""
        from stlbench_methods.counter_kernels import run  # imports Numba, which building a method does without

        return run(self._tables, truths(self._holds, samples), t, self._margin, memory), memory
