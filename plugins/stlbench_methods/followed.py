"""What methods share that follow a formula's value: `dense` and `tltl`."""

from __future__ import annotations

from stlbench import stl
from stlbench.contract import Array, Integers, Specification
from stlbench_methods.progress import Progress
from stlbench_methods.values import Margins, SemanticsName


class Followed:
    """Beside `RewardMethod`: the memory is how far the formula is, and the policy sees all of it."""

    memory_size: int
    _progress: Progress

    def _follow(self, specification: Specification, semantics: SemanticsName, sharpness: float) -> None:
        """To be called by the constructor. Raises `Unsuitable` as `Progress` and `Margins` do."""
        self._progress = Progress(specification, Margins(specification, stl.semantics(semantics, sharpness)))
        self.memory_size = self._progress.size

    @property
    def input_size(self) -> int:
        """See `Progress.inputs`."""
        return self._progress.input_size

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        """How far the first sample is, as if it had been there since step 0."""
        return self._progress.begin(signals, t)

    def inputs(self, memory: Array) -> Array:
        """What there is to know of each term, its range scaled to [-1, 1]."""
        return self._progress.inputs(memory)
