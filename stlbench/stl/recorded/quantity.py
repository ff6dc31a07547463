"""A formula under any quantitative semantics, on recorded traces: one evaluator for all of them.

`robustness` is the special case of minimum and maximum, and much faster.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from stlbench.stl.arithmetic.folds import Semantics
from stlbench.stl.errors import ShortTraceError
from stlbench.stl.language.structure import as_names, first_past, horizon, is_temporal, negations_inside, operands_of
from stlbench.stl.language.syntax import And, Between, Connective, Formula, Not, Or, Prefix, Release
from stlbench.stl.predicates import margin

Floats: TypeAlias = NDArray[np.float64]
#: a leaf to the function of samples (..., k) -> (...) that is its value
Valued: TypeAlias = Callable[[Formula], Callable[[Floats], Floats]]
#: the values of an empty F and an empty G
Empty: TypeAlias = tuple[float, float]
_WHOLE = 10_000
"""Windows up to so many samples are padded to their whole length. Sums of another length round otherwise, and longer
windows cost too much memory."""


class Quantity:
    """A formula whose leaves have values, which `semantics` combines.

    Leaves are the largest parts without temporal operators, or single predicates where the semantics is made for
    values of about [-1, 1]. Negations are pushed into them.

    Attributes:
        formula: with its negations inside.
        leaves: the J different leaves, in order of appearance.
        horizon: steps that the formula looks ahead.
    """

    def __init__(
        self, formula: Formula, names: Sequence[str], semantics: Semantics, valued: Valued | None = None
    ) -> None:
        """Read `formula` on the signals `names`; `valued` gives the value of a leaf, where it is not the margin.

        Raises:
            UnboundedError: an operator has no interval.
            ValueError: a past operator, which has the classic robustness alone.
            UnknownSignalError: the formula uses a signal that is not in `names`.
        """
        if (past := first_past(formula)) is not None:
            raise ValueError(f"semantics are of operators that look ahead, not of the past operator {past.operator}")
        self.horizon, self.semantics = horizon(formula), semantics
        self.formula = negations_inside(formula, to_predicates=semantics.divided)
        self.leaves = tuple(dict.fromkeys(_leaves(self.formula, semantics.divided)))
        known = as_names(names, formula)
        self._read = [valued(leaf) if valued else margin(leaf, known) for leaf in self.leaves]

    def read(self, samples: Floats) -> Floats:
        """The values of the leaves: (..., k) -> (..., J); NaN where a predicate has none."""
        return np.stack([np.broadcast_to(read(samples), samples.shape[:-1]) for read in self._read], axis=-1)

    def values(self, leaves: Floats) -> Floats:
        """The formula's value at each step at which it has one: (n, T+1, J) -> (n, T+1-horizon).

        Raises:
            ShortTraceError: T < horizon.
        """
        if leaves.shape[1] <= self.horizon:
            raise ShortTraceError(self.horizon + 1, leaves.shape[1], advice="")
        return self._at(self.formula, leaves, (0, leaves.shape[1] - 1 - self.horizon), (-math.inf, math.inf))

    def clipped(self, leaves: Floats, ends: Empty) -> Floats:
        """The same at every step, (n, T+1), with windows cut at T; `ends` are those of an empty F and G."""
        return self._at(self.formula, leaves, (0, leaves.shape[1] - 1), ends)

    def _at(self, node: Formula, leaves: Floats, steps: tuple[int, int], ends: Empty) -> Floats:
        """The values of a part at the first to the last of `steps`, (n, last - first + 1)."""
        if node in self.leaves:
            return leaves[:, steps[0] : steps[1] + 1, self.leaves.index(node)]
        match node:
            case Connective():
                fold = self.semantics.least if node.least else self.semantics.greatest
                return fold.of([self._at(arg, leaves, steps, ends) for arg, _ in node.signed])
            case Prefix():
                return self._window(node, leaves, steps, ends)
            case Between():
                each = [self._between(node, leaves, t, ends) for t in range(steps[0], steps[1] + 1)]
                return np.stack(each, axis=-1)
            case _:  # pragma: no cover - a leaf
                raise AssertionError(node)

    def _window(self, node: Prefix, leaves: Floats, steps: tuple[int, int], ends: Empty) -> Floats:
        lo, hi = steps
        fold = self.semantics.least if node.least else self.semantics.eventually
        first, last = lo + node.a, leaves.shape[1] - 1
        b = min(node.b, max(node.a, last + 1, _WHOLE))  # beyond the last sample nothing counts
        read = min(hi + b, last)
        lifted = np.full((len(leaves), hi + b - first + 1, fold.size), fold.empty)
        if first <= read:
            lifted[:, : read - first + 1] = fold.lift(self._at(node.arg, leaves, (first, read), ends))
        values = fold.read(fold.sliding(lifted, b - node.a + 1))
        values[:, max(last - node.a - lo + 1, 0) :] = ends[node.least]  # of windows that begin after the last sample
        return values

    def _between(self, node: Between, leaves: Floats, t: int, ends: Empty) -> Floats:
        """At one step: the least of each goal in the interval and of the guard before it, and the greatest of these.

        For a release the greatest of each, and the least of these.
        """
        least, pick, empty = self.semantics.least, self.semantics.eventually, ends[0]
        if isinstance(node, Release):
            least, pick, empty = self.semantics.greatest, self.semantics.least, ends[1]
        first, last = t + node.a, min(t + node.b, leaves.shape[1] - 1)
        if first > last:
            return np.full(len(leaves), empty)
        goal = self._at(node.right, leaves, (first, last), ends)
        if last > t:
            guards = least.lift(self._at(node.left, leaves, (t, last - 1), ends))
            before = least.read(least.accumulated(guards))[:, max(first - t - 1, 0) :]
            alone = goal.shape[1] - before.shape[1]  # 1 where the first goal is at t itself, without a guard
            guarded = least.of([goal[:, alone:], before])
            goal = np.concatenate([goal[:, :alone], guarded], axis=1)
        return pick(goal)


def _leaves(node: Formula, predicates: bool) -> Iterator[Formula]:
    inner = node.arg if isinstance(node, Not) else node
    if is_temporal(node) or (predicates and isinstance(inner, And | Or)):
        for part in operands_of(inner):
            yield from _leaves(part, predicates)
    else:
        yield node
