"""Any formula while its trace grows: two numbers hold what is decided, and only what is open is evaluated.

It serves what no stream has: operands that are known in part while they are open; and many traces with short windows.

Every temporal formula is an until, or the opposite of one: see `as_until`.
Let h be how many steps the operands look ahead. At sample n, the operands are decided at the steps up to n - h. Two
numbers hold what these steps mean for the until. The operands are evaluated at the last h steps and at one step that
stands for all later ones. So the cost of a step depends on the operands alone: not on the length of the trace, and not
on the interval of the until.

Operands that look ahead without an interval are never decided: all samples are state and evaluated at each step.
"""

from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from stlbench.stl.arithmetic.folds import until
from stlbench.stl.errors import UndefinedError
from stlbench.stl.language import structure, syntax
from stlbench.stl.recorded.evaluator import Evaluator, Traces, evaluator, unknown
from stlbench.stl.running.pulling import as_until

Floats: TypeAlias = NDArray[np.float64]
Steps: TypeAlias = NDArray[np.int64]


class Decided(NamedTuple):
    """The effect of the decided steps of n traces."""

    best: Floats  # (n,): the value of the until
    guard: Floats  # (n,): the least value of its left operand
    before: Mapping[syntax.Formula, Floats]  # of past operators without an interval, see `Traces`


class Known(NamedTuple):
    """The bounds of the until, and the state after the sample."""

    lower: Floats
    upper: Floats
    state: Decided


class Recent:
    """The newest samples of n traces that are all given a sample at a time."""

    def __init__(self, count: int, signals: int) -> None:
        self.rows: Floats = np.empty((count, 4, signals))
        self.size = 0

    def with_newest(self, samples: Floats, count: int) -> Floats:
        """The last `count` with `samples` (n, k) as the newest, which is not taken yet: a view (n, count, k)."""
        self.rows[:, self.size] = samples
        return self.rows[:, self.size + 1 - count : self.size + 1]

    def take(self, keep: int) -> None:
        """Take the newest, and keep the last `keep` with it, or more."""
        self.size += 1
        if self.size < self.rows.shape[1]:
            return
        recent = self.rows[:, self.size - min(keep, self.size) :]
        grown = np.empty((len(recent), max(4, 2 * recent.shape[1] + 2), recent.shape[2]))
        grown[:, : recent.shape[1]] = recent
        self.rows, self.size = grown, recent.shape[1]


class Unfolding:
    """A temporal formula as an until of operands that may look ahead and back.

    Attributes:
        flipped: whether the formula is the opposite of the until.
        window: how many samples an evaluation reads, the newest included; `END` for all.
        last: the last step that counts, or `END`.
    """

    def __init__(self, formula: syntax.Formula, names: tuple[str, ...]) -> None:
        self.names = names
        self.flipped, self.a, self.b, left, right = as_until(formula)
        operands = (left, right)
        self.always = left == syntax.TrueFormula()
        self.left, self.right = left, right
        self.ahead = syntax.END if any(map(structure.is_endless, operands)) else max(map(structure.lookahead, operands))
        self.behind = max(map(structure.lookbehind, operands))
        self.last = syntax.END if syntax.END in (self.ahead, self.b) else self.b + self.ahead
        self.reaches = (
            self.always and structure.first_past(right) is None and unknown(right, names, "signed", False) == np.inf
        )
        self.window = min(syntax.END, self.ahead + self.behind + 1)
        endless = (
            node
            for operand in operands
            for node in structure.walk(operand)
            if isinstance(node, syntax.Temporal) and node.past and node.b == syntax.END
        )
        self.carried = {node: max(map(structure.lookbehind, structure.operands_of(node))) for node in endless}

    def phases(self, now: Steps) -> Steps:
        """The earliest steps (n,) that are read as the steps `now` are; traces of one phase can be read together."""
        if self.ahead == syntax.END:
            return now
        settled = max(self.window, self.a + self.ahead)
        return np.where((settled <= now) & (now < self.b - self.behind), settled, now)

    def begin(self, count: int) -> Decided:
        return Decided(np.full(count, -np.inf), np.full(count, np.inf), {})

    def read(self, samples: Floats, now: int, state: Decided) -> Known:
        """The bounds after samples (n, min(now + 1, window), k), the last at step `now` <= `last`, by the state before.

        Raises UndefinedError, with the step and the row, where a predicate that is read has no value.
        """
        size = samples.shape[1]
        first = now + 1 - size
        last = min(size + self.behind, self.last - first)  # no step beyond the last that counts
        traces = Traces(samples, "interval", last, 0, state.before if first else {})
        try:
            known = self._defined_bounds(traces, first, now, state)
        except UndefinedError as error:
            raise UndefinedError(error.what, first + (error.sample or 0), error.trace) from None
        if self.carried and size == self.window:
            with np.errstate(all="ignore"):
                ends = ((node, self._evaluator(node)(traces, at, at, True)[:, 0]) for node, at in self.carried.items())
                known = known._replace(state=known.state._replace(before=dict(ends)))
        return known

    def _defined_bounds(self, traces: Traces, first: int, now: int, state: Decided) -> Known:
        """The bounds; UndefinedError where a predicate that is read has no value."""
        try:
            with np.errstate(all="ignore", over="raise"):
                known = self._bounds(traces, first, now, state)
            if not (np.isnan(known.lower).any() or np.isnan(known.upper).any()):
                return known
        except FloatingPointError:  # of some operation
            pass
        with np.errstate(all="ignore"):
            return self._bounds(traces, first, now, state, checked=True)

    def _bounds(self, traces: Traces, first: int, now: int, state: Decided, checked: bool = False) -> Known:
        """The until from the first step on that was not decided before, joined with the state."""
        at = max(0, now - self.ahead)
        start, stop = max(self.a - at, 0), min(self.b - at, traces.last - at + first)
        step, ends = at - first, list[Floats]()
        goal = guard = np.empty((len(state.best), 0))
        left, right = self._evaluator(self.left, checked), self._evaluator(self.right, checked)
        for worst in (True, False):
            if not worst and self.reaches and now < self.b:  # a step to come may be as good as can be
                ends.append(np.full(len(goal), np.inf))
                continue
            goal = right(traces, step + min(start, stop), step + stop, worst)
            guard = np.full((len(goal), 0), np.inf)
            if not self.always and (reach := stop - (start <= stop)) >= 0:
                guard = left(traces, step, step + reach, worst)
            ends.append(np.maximum(state.best, np.minimum(state.guard, _first(goal, guard, start))))
        if now >= self.ahead:
            best = np.maximum(state.best, np.minimum(state.guard, goal[:, 0])) if start == 0 else state.best
            least = np.minimum(state.guard, guard[:, 0]) if guard.shape[1] else state.guard
            state = state._replace(best=best, guard=least)
        return Known(ends[0], ends[1], state)

    def _evaluator(self, formula: syntax.Formula, checked: bool = False) -> Evaluator:
        return evaluator(formula, self.names, "signed", checked)


def _first(goal: Floats, guard: Floats, start: int) -> Floats:
    """The until at one step: goals (n, m) from step `start` on, guards (n, ...) from 0 on, none where they hold."""
    if not guard.shape[1]:
        return np.asarray(goal.max(axis=1))
    if start > guard.shape[1]:  # beyond the step that stands for all to come
        return np.asarray(np.minimum(goal[:, -1], guard.min(axis=1)))
    return np.asarray(until(guard, goal, start, 1)[:, 0])
