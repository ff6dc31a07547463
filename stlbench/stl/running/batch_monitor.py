"""An online monitor of many traces at once, as a vector environment makes them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stlbench.stl.errors import UndefinedError
from stlbench.stl.language.horizon import horizon
from stlbench.stl.language.syntax import Formula
from stlbench.stl.predicates.compiler import check_names
from stlbench.stl.predicates.sided import SIDE
from stlbench.stl.running.batch_operators import Floats, Mask, many
from stlbench.stl.running.operator_tree import Tree


class Intervals(NamedTuple):
    """What is known of each of n traces; arrays (n,), not to be written to.

    Attributes:
        lower, upper: bounds of the robustness at t = 0 over all continuations.
        certainly: whether every continuation satisfies the formula (Boolean semantics).
        possibly: whether some continuation may.
    """

    lower: Floats
    upper: Floats
    certainly: Mask
    possibly: Mask


class BatchMonitor:
    """Watches `count` traces for `formula`, each on its own clock; says for each what `Monitor` says for one.

    Costs a fixed number of NumPy calls a step for the formulas that cost `Monitor` constant work, and `count` times
    `Monitor`'s work for the others. `copy.deepcopy` forks it.

    Raises:
        UnknownSignalError: the formula uses a signal that is not in `names`.
    """

    def __init__(self, formula: Formula, names: Sequence[str], count: int) -> None:
        """Start before the first samples; `names` are the signals of a sample, in order; count >= 1."""
        self.formula, self.names = formula, tuple(names)
        check_names(formula, self.names)
        if count < 1:
            raise ValueError(f"a batch has at least 1 trace, got {count}")
        self.horizon = horizon(formula)
        self.steps: NDArray[np.int64] = np.zeros(count, dtype=np.int64)
        self._tree = Tree(formula, self.names, many(count))
        self._youngest = self._oldest = 0  # of the clocks
        self._answer = self._ask()

    def update(self, samples: ArrayLike) -> Intervals:
        """Take the next sample of each trace (n, k) and return what is known now. Later arrays do not share memory.

        Raises:
            UndefinedError: a sample has a NaN or a predicate no value at it, within the first horizon + 1 of its trace.
            ValueError: the samples are not of shape (n, k).
        """
        rows = np.asarray(samples, dtype=np.float64)
        self._check(rows)
        reading = [leaf for leaf in self._tree.leaves if leaf.start <= self._oldest and self._youngest <= leaf.stop]
        with np.errstate(all="ignore"):
            for leaf in reading:
                leaf.step(self.steps, rows)
        self.steps += 1
        self._youngest += 1
        self._oldest += 1
        if reading:
            self._answer = self._ask()
        return self._answer

    def restart(self, which: ArrayLike) -> None:
        """Start some traces anew, before their next sample: a mask (n,) of booleans, or indices."""
        chosen = np.asarray(which)
        self.steps[chosen] = 0
        for leaf in self._tree.leaves:
            leaf.restart(chosen)
        self._youngest, self._oldest = int(self.steps.min()), int(self.steps.max())
        self._answer = self._ask()

    def _check(self, rows: Floats) -> None:
        shape = (len(self.steps), len(self.names))
        if rows.shape != shape:
            raise ValueError(f"samples have shape {shape} for {', '.join(self.names)}, got {rows.shape}")
        missing = np.isnan(rows)
        if not missing.any():
            return
        missing[self.steps > self.horizon] = False
        if missing.any():
            trace, column = np.argwhere(missing)[0].tolist()
            raise UndefinedError(f"signal {self.names[column]!r} is NaN at sample {self.steps[trace]} of trace {trace}")

    def _ask(self) -> Intervals:
        lower, upper = self._tree.root.bounds()
        return Intervals(_robustness(lower), _robustness(upper), lower > 0.0, upper > 0.0)


def _robustness(sided: Floats) -> Floats:
    return np.where(abs(sided) <= SIDE, 0.0, sided)
