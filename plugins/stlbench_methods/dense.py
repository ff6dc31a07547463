"""dense: the robustness of the trace so far, at every step (STLGym, Hamilton et al. 2022), or how it grows."""

from typing import Literal

import numpy as np

from stlbench.contract import Array, Integers, Specification
from stlbench_methods.formula_parts import SemanticsName, Sharpness
from stlbench_methods.progress import Followed


class Dense(Followed):
    """The formula's robustness on the samples so far, or the growth of what is certain of it.

    `level` is the robustness of the trace up to now, with windows cut at its end, as STLGym has it. An F of which no
    step has been yet is worth its least over the box of the signals, a G its greatest.

    `difference` is L_{t+1} - L_t, where L_t is the least robustness that the whole trace can still have while the
    signals are in their box. Its sum over an episode is the robustness less L_0, a constant of the start. So it asks
    for the same as `tltl` if nothing is discounted, but robustness is paid for as soon as it is certain.

    Args:
        mode: `level` or `difference`.
        semantics: what stands for minimum and maximum; see `stlbench.stl.semantics`. All but `classic` divide each
            predicate by its largest size over the box of the signals.
        sharpness: of `lse` and `gilpin`.

    Raises:
        Unsuitable: an operator looks back, or a part of the formula has no bounds.
    """

    def __init__(
        self,
        specification: Specification,
        *,
        mode: Literal["level", "difference"] = "level",
        semantics: SemanticsName = "classic",
        sharpness: Sharpness = 10.0,
    ) -> None:
        super().__init__(specification, semantics=semantics, sharpness=sharpness)
        self._difference = mode == "difference"
        if self._difference:
            self.scale = self._progress.ends[1] - self._progress.ends[0]
        self.floor = 0.0 if self._difference else self._progress.ends[0]

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        progress = self._progress
        after = progress.along(samples[1:], t + 1, memory)
        if not self._difference:
            return np.stack([progress.so_far(each, t + i) for i, each in enumerate(after, 1)]), after[-1]
        levels = [progress.at_least(each, t + i) for i, each in enumerate([memory, *after])]
        return np.diff(np.stack(levels), axis=0), after[-1]
