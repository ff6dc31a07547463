"""flag: F-MDP, one flag per term instead of a history (Venkataraman, Aksaray, Seiler, L4DC 2020)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from stlbench.contract import Array, Integers, RewardMethod, Specification
from stlbench_methods.flag_counting import AbsoluteFlags, Flags, WindowFlags, is_windowed


class Flag(RewardMethod):
    """One flag per term, updated from the predicate alone; the reward is for the truth of the flags.

    Where the task (or its nested form) reads (F|G)[0,Te] phi, with phi an and/or of F[0,w] psi and G[0,w] psi: integer
    counters over windows of w + 1 samples, sat = and/or of their verdicts, and the reward exp(beta (sat - 1)) for an
    outer F, -exp(-beta sat) for an outer G. Both are in [-1, 1]: exp(beta sat) is scaled by exp(-beta). Windows may all
    begin at the same later step, as in G[0,Te] G[300,310] psi: an extension, as the source has them from 0.

    Any other formula of the fragment of eq. 2 has no outer operator and absolute intervals, which that method does
    not treat. The extension: F[a,b] psi has a flag latched once psi held in [a,b]; the flag of G[a,b] psi is 1 until
    psi fails in [a,b]; F[a,c1] G[c2,b] psi counts samples of psi and latches at a full window. Each is paid as above,
    F or G, on its own interval; where intervals overlap, the sum.

    Args:
        beta: 50 in the sources; at that value the reward is 0 or 1 in size.

    Raises:
        Unsuitable: the formula has neither form.
    """

    def __init__(self, specification: Specification, *, beta: Annotated[float, Field(gt=0)] = 50.0) -> None:
        super().__init__(specification)
        nested = specification.nested or specification.formula
        windowed = is_windowed(nested)
        self._flags: Flags = (
            WindowFlags(nested, specification, beta) if windowed else AbsoluteFlags(specification, beta)
        )
        self.memory_size, self.scale = len(self._flags.full), self._flags.scale
        self.extension = self._flags.extension

    @property
    def floor(self) -> float:
        """The least that the flags can be paid at a sample."""
        return self._flags.floor

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        """The flags after the first sample, (N, m); they were 0 before it (1 for the absolute G), whenever it is."""
        before = np.tile(self._flags.initial, (len(signals), 1))
        return self._flags.along(signals[None], t, before)[1]

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        """The rewards (h, N) for the flags that include each next sample, and the flags after the last (N, m)."""
        return self._flags.along(samples[1:], t + 1, memory)

    def inputs(self, memory: Array) -> Array:
        """Each flag over its full value: in [0, 1]."""
        return memory / self._flags.full

    def describe(self) -> Mapping[str, Any]:
        """Which form was taken, and each flag's full count."""
        return {"form": self._flags.form, "flags": [int(value) for value in self._flags.full]}
