"""A formula as a tree of online operators, the same for one trace (`scalar`) and for many (`batch`).

Values are signed margins (see `dialect`), and bounds are of the value at t = 0 over all continuations of the samples.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeAlias, TypeVar

from stlbench.stl.errors import FormulaLimitError
from stlbench.stl.language import syntax
from stlbench.stl.language.expressions import MAX_DEPTH
from stlbench.stl.language.structure import horizon, is_endless, is_temporal
from stlbench.stl.recorded.evaluator import unknown

#: least and greatest value, as floats or as arrays
Ends: TypeAlias = tuple[Any, Any]
Interval: TypeAlias = tuple[int, int]


class UnsupportedError(Exception):
    """The formula has something that is known in part while it is still open."""


class Pointwise(NamedTuple):
    """A formula without temporal operators, to be read at a sample."""

    value: Any  # at a sample, as the operators of the tree read it; UndefinedError where there is none
    unknown: tuple[float, float]  # the least and the greatest value at a sample that has not come yet


class Leaf:
    """A node that reads samples, at steps `start`..`stop` alone; its bounds `ends` cannot change at others.

    All leaves first read a sample, which may fail and changes nothing. Then all take it, which cannot fail. So a sample
    that is refused leaves no trace.

    Every leaf is a maximum: G psi is !(F !psi), so a `flipped` leaf publishes its bounds negated and swapped.
    """

    def __init__(self, start: int, stop: int, flipped: bool) -> None:
        self.start, self.stop, self.flipped = start, stop, flipped
        self.ends: Ends

    def bounds(self) -> Ends:
        lower, upper = self.ends
        return (-upper, -lower) if self.flipped else (lower, upper)


L = TypeVar("L", bound=Leaf)
#: any node of the tree
Node: TypeAlias = "Leaf | Joined"


@dataclass(frozen=True)
class Joined:
    """Conjunction (`pick` is the least of a sequence) or disjunction (the greatest): bounds combine end by end."""

    parts: Sequence[Node]
    pick: Callable[[Sequence[Any]], Any]

    def bounds(self) -> Ends:
        ends = [part.bounds() for part in self.parts]
        return self.pick([lower for lower, _ in ends]), self.pick([upper for _, upper in ends])


@dataclass(frozen=True)
class Kit(Generic[L]):
    """The operators that a tree is made of; `negated` and `flipped` are the last arguments."""

    least: Callable[[Sequence[Any]], Any]
    greatest: Callable[[Sequence[Any]], Any]
    value: Callable[[syntax.Formula, tuple[str, ...], bool], Any]  # of psi, or of !psi
    until: Callable[[Pointwise | None, Pointwise, Interval, bool], L]  # F[a,b] right where left is None
    nested: Callable[[Pointwise, Interval, Interval, bool], L] | None  # F[a,c] G[d,e] psi; else it is `streamed`
    streamed: Callable[[syntax.Formula, tuple[str, ...], bool], L]  # most others; raises UnsupportedError for the rest
    replayed: Callable[[syntax.Formula, tuple[str, ...], bool], L]  # any temporal formula


class Tree(Generic[L]):
    """The cheapest operators that are exact for `formula`: `root` answers, `leaves` take the samples."""

    def __init__(self, formula: syntax.Formula, names: tuple[str, ...], kit: Kit[L]) -> None:
        self.kit, self.names = kit, names
        self.leaves: list[L] = []
        self.root = self._build(formula, False)

    def _build(self, formula: syntax.Formula, negated: bool) -> Node:
        kit = self.kit
        match formula:
            case _ if not is_temporal(formula):
                return self._eventually(formula, (0, 0), negated, False)
            case syntax.Not(arg):
                return self._build(arg, not negated)
            case syntax.Connective():
                parts = [self._build(arg, own is not negated) for arg, own in _together(formula)]
                return Joined(parts, kit.least if formula.least is not negated else kit.greatest)
            case syntax.Prefix(a, b, arg) if not (formula.past or is_temporal(arg)):
                return self._eventually(arg, (a, b), formula.least, formula.least is not negated)
            case syntax.Prefix(a, b, syntax.Prefix(c, d, arg) as inner) if not (
                formula.past or inner.past or is_temporal(arg)
            ):
                least, flipped = formula.least, formula.least is not negated
                if inner.least is least:
                    return self._eventually(arg, (a + c, syntax.END if syntax.END in (b, d) else b + d), least, flipped)
                if d == syntax.END:  # of such windows the last one demands least; the first reads most
                    windows = [self._eventually(arg, (start, d), not least, not flipped) for start in (a, b)]
                    return Joined(windows, kit.least if flipped else kit.greatest)
                if kit.nested is None:
                    return self._streamed(formula, negated)
                return self._leaf(kit.nested(self._pointwise(arg, least), (a, b), (c, d), flipped))
            case syntax.Prefix(a, _, arg) | syntax.Since(a, _, _, arg) if formula.past:  # it is read at step 0
                now = arg if a == 0 else syntax.TrueFormula()
                return self._build(now, negated if a == 0 or formula.letter == "H" else not negated)
            case syntax.Between(a, b, left, right) if not (formula.past or is_temporal(left) or is_temporal(right)):
                dual = isinstance(formula, syntax.Release)  # a release is the opposite of an until of the opposites
                psis = self._pointwise(left, dual), self._pointwise(right, dual)
                return self._leaf(kit.until(*psis, (a, b), dual is not negated))
            case _:
                return self._streamed(formula, negated)

    def _streamed(self, formula: syntax.Formula, negated: bool) -> L:
        try:
            return self._leaf(self.kit.streamed(formula, self.names, negated))
        except (UnsupportedError, FormulaLimitError):
            return self._leaf(self.kit.replayed(formula, self.names, negated))

    def _eventually(self, psi: syntax.Formula, interval: Interval, negated: bool, flipped: bool) -> Node:
        return self._leaf(self.kit.until(None, self._pointwise(psi, negated), interval, flipped))

    def _pointwise(self, psi: syntax.Formula, negated: bool) -> Pointwise:
        whole = syntax.Not(psi) if negated else psi
        lower, upper = (unknown(whole, self.names, "signed", worst) for worst in (True, False))
        return Pointwise(self.kit.value(psi, self.names, negated), (lower, upper))

    def _leaf(self, leaf: L) -> L:
        self.leaves.append(leaf)
        return leaf


def _together(formula: syntax.Connective) -> Sequence[tuple[syntax.Formula, bool]]:
    """The signed operands, where all G[a,b] psi of an `&` (all F of an `|`) with the same interval become one.

    So thousands of conjuncts are a few operators.
    """
    if not isinstance(formula, syntax.And | syntax.Or) or formula.depth >= MAX_DEPTH - 1:
        return formula.signed
    kind, window = (syntax.And, syntax.Always) if formula.least else (syntax.Or, syntax.Eventually)
    now, windows, others = list[syntax.Formula](), dict[Interval, list[syntax.Formula]](), list[syntax.Formula]()
    for arg in formula.args:
        if not is_temporal(arg):
            now.append(arg)
        elif isinstance(arg, window) and not is_temporal(arg.arg):
            windows.setdefault((arg.a, arg.b), []).append(arg.arg)
        else:
            others.append(arg)

    def one(psis: Sequence[syntax.Formula]) -> syntax.Formula:
        return kind(tuple(psis)) if len(psis) > 1 else psis[0]

    joined = [window(a, b, one(psis)) for (a, b), psis in windows.items()]
    return [(arg, False) for arg in (*([one(now)] if now else []), *joined, *others)]


def last_step(formula: syntax.Formula) -> int:
    """The last step that `formula` reads at t = 0: its horizon, or `END`."""
    return syntax.END if is_endless(formula) else horizon(formula)
