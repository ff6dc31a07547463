"""tau-cmdp: flags in place of the last tau samples (Ikemoto, Ushio, IEEE Access 2022), without its Lagrangian."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from stlbench.contract import Array, Integers, Specification
from stlbench_methods.flag import Flag


class TauCmdp(Flag):
    """One flag per window, shown as f - 1/2; a transition is paid for the window before it.

    The source preprocesses the last tau samples to flags. The flag of F[0,w] psi is 1 when psi holds, and else falls by
    1/(w + 1). That of G[0,w] psi rises by 1/(w + 1), and else falls to 0. These are the counters of `flag` over w + 1.
    The transition from s_t is paid for the window that ends with s_t: -exp(-beta sat) for an outer G, and exp(beta sat)
    times exp(-beta) for an outer F. So the window that ends with s_T is never paid for, and that of s_0 is.

    In the source this reward is the constraint of a constrained problem, whose own reward is for the control; a
    multiplier weighs the two. A task has no such other reward, so it is what is maximised here. Formulas without an
    outer operator are treated as by `flag`.

    Args:
        beta: 100 in the source.
        window: the window that a transition is paid for. `before`: it ends with s_t. `after`: with s_{t+1}, as `flag`.

    Raises:
        Unsuitable: as `flag`.
    """

    def __init__(
        self,
        specification: Specification,
        *,
        beta: Annotated[float, Field(gt=0)] = 100.0,
        window: Literal["before", "after"] = "before",
    ) -> None:
        super().__init__(specification, beta=beta)
        self.input_size, self._before = self.memory_size, window == "before"
        self.memory_size += 1

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        before = np.tile(self._flags.initial, (len(signals), 1))
        worth, flags = self._flags.along(signals[None], t, before)
        return np.column_stack([flags, worth[0]])

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        worth, flags = super().along(samples, action, t, memory[:, :-1])
        rewards = np.concatenate([memory[None, :, -1], worth[:-1]]) if self._before else worth
        return rewards, np.column_stack([flags, worth[-1]])

    def inputs(self, memory: Array) -> Array:
        return super().inputs(memory[:, :-1]) - 0.5
