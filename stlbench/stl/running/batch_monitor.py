"""An online monitor of many traces at once, as a vector environment makes them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stlbench.stl.errors import UndefinedError, shorten
from stlbench.stl.language.syntax import Formula
from stlbench.stl.language.traversal import require_formula
from stlbench.stl.predicates.inputs import as_array, as_names, check_names
from stlbench.stl.predicates.signed_margin import SIDE
from stlbench.stl.running.batch_operators import Floats, Mask, many
from stlbench.stl.running.operator_tree import Tree, last_step


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

    Costs a fixed number of NumPy calls per step for the formulas that cost `Monitor` constant work; the others are
    evaluated again at each step, once for all traces of one age. `copy.deepcopy` forks it.

    Raises:
        UnknownSignalError: the formula uses a signal that is not in `names`.
    """

    def __init__(self, formula: Formula, names: Sequence[str], count: int) -> None:
        """Start before the first samples; `names` are the signals of a sample, in order; count >= 1."""
        require_formula(formula)
        self.formula, self.names = formula, as_names(names)
        check_names(formula, self.names)
        if count < 1:
            raise ValueError(f"a batch has at least 1 trace, got {count}")
        self.horizon = last_step(formula)
        self.steps: NDArray[np.int64] = np.zeros(count, dtype=np.int64)
        self._tree = Tree(formula, self.names, many(count))
        self._youngest = self._oldest = 0  # of the clocks
        self._answer = self._ask()

    def update(self, samples: ArrayLike) -> Intervals:
        """Take the next sample of each trace (n, k) and return what is known now. Later arrays do not share memory.

        Raises:
            UndefinedError: a predicate that is read has no value at a sample: a signal is NaN, or its arithmetic has
                none. All traces stay as they were before.
            TypeError: a masked array.
            ValueError: the samples are not of shape (n, k).
        """
        rows = np.array(as_array(samples), dtype=np.float64)
        if rows.shape != (len(self.steps), len(self.names)):
            expected = (len(self.steps), len(self.names))
            raise ValueError(f"samples have shape {expected} for {', '.join(self.names)}, got {rows.shape}")
        reading = [leaf for leaf in self._tree.leaves if leaf.start <= self._oldest and self._youngest <= leaf.stop]
        with np.errstate(all="ignore"):
            try:
                values = [leaf.read(self.steps, rows) for leaf in reading]
            except UndefinedError as error:
                sample = None if error.trace is None else int(self.steps[error.trace])
                raise UndefinedError(error.what, sample, error.trace) from None
            for leaf, value in zip(reading, values, strict=True):
                leaf.take(self.steps, value)
        self.steps += 1
        self._youngest += 1
        self._oldest += 1
        if reading:
            self._answer = self._ask()
        return self._answer

    def restart(self, which: ArrayLike) -> None:
        """Start some traces anew, before their next sample: a mask (n,) of booleans, or indices, none allowed.

        Raises:
            ValueError: a mask of another length, an index outside 0..n-1, or no mask and no indices at all.
        """
        chosen = self._indices(which)
        self.steps[chosen] = 0
        for leaf in self._tree.leaves:
            leaf.restart(chosen)
        self._youngest, self._oldest = int(self.steps.min()), int(self.steps.max())
        self._answer = self._ask()

    def _indices(self, which: ArrayLike) -> NDArray[np.int64]:
        chosen, count = np.atleast_1d(as_array(which)), len(self.steps)
        if chosen.dtype == np.bool_ and chosen.shape == (count,):
            return np.flatnonzero(chosen)
        if chosen.size == 0:
            return np.empty(0, dtype=np.int64)
        if chosen.ndim == 1 and chosen.dtype.kind in "iu" and chosen.min() >= 0 and chosen.max() < count:
            return chosen.astype(np.int64)
        shown = shorten(repr(chosen.tolist()))
        raise ValueError(f"which traces: a mask of {count} booleans, or indices from 0 to {count - 1}; got {shown}")

    def _ask(self) -> Intervals:
        lower, upper = self._tree.root.bounds()
        return Intervals(_robustness(lower), _robustness(upper), lower > 0.0, upper > 0.0)


def _robustness(signed: Floats) -> Floats:
    return np.where(abs(signed) <= SIDE, 0.0, signed)
