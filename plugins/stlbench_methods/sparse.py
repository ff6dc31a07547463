"""sparse: the formula's verdict, paid once at the end, which every other method tries to improve on."""

from typing import Literal

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Integers, RewardMethod, Specification, Truth, Unsuitable
from stlbench_methods.flag import AbsoluteFlags
from stlbench_methods.formula_parts import Truths
from stlbench_methods.progress import Progress, at_the_end


class Sparse(RewardMethod):
    """1 at the last transition of an episode that satisfies the formula, else 0.

    The verdict is the Boolean one, which the referee uses too, and not the sign of the robustness.

    The policy sees how far the formula is. In the fragment of eq. 2, F psi and G psi have one flag. F[a,c1] G[c2,b] psi
    has a flag and a count of samples of psi in a row. Outside the fragment each outer F and G has a running verdict,
    and the last truths of the parts that look ahead inside it.

    Args:
        pays: `success`, as above; `failure`, -1 if the formula does not hold, else 0.

    Raises:
        Unsuitable: an operator looks back.
    """

    def __init__(self, specification: Specification, *, pays: Literal["success", "failure"] = "success") -> None:
        super().__init__(specification)
        self.floor = 0.0 if pays == "success" else -1.0
        self._known: AbsoluteFlags | Progress
        try:
            self._known = AbsoluteFlags(specification, 1.0)  # beta is of no account: its rewards are not used
        except Unsuitable:
            self._known = Progress(specification, Truths(specification, stl.semantics("classic")))
        self.memory_size = self._known.size
        self.input_size = self._known.input_size if isinstance(self._known, Progress) else self._known.size

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        return self._known.begin(signals, t)

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        *_, memory = self._known.along(samples[1:], t + 1, memory)
        return at_the_end(self._paid, self.specification.steps, len(samples) - 1, t, memory), memory

    def inputs(self, memory: Array) -> Array:
        return self._known.inputs(memory)

    def _paid(self, memory: Array, t: Integers) -> Array:
        satisfied: Truth
        if isinstance(self._known, Progress):
            satisfied = self._known.so_far(memory, t) > 0.5
        else:
            satisfied = (memory[:, self._known.columns] == 1).all(axis=1)
        return np.where(satisfied, 1.0, 0.0) + self.floor
