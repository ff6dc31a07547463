"""A formula as a tree of online operators, the same for one trace (`scalar_operators`) and many (`batch_operators`).

Values are signed (see `signed_margin`); bounds are of the value at t = 0 over all continuations of the samples so far.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, Protocol, TypeAlias, TypeVar

from stlbench.stl.language.horizon import horizon, unbounded
from stlbench.stl.language.node import MAX_DEPTH
from stlbench.stl.language.syntax import END, Always, And, Eventually, Formula, Implies, Not, Or, Release, Until
from stlbench.stl.language.traversal import is_temporal
from stlbench.stl.predicates.compiler import compile_signed
from stlbench.stl.recorded.evaluator import unknown

#: least and greatest value, as floats or as arrays
Ends: TypeAlias = tuple[Any, Any]
Interval: TypeAlias = tuple[int, int]


class Part(Protocol):
    """Any node of the tree."""

    def bounds(self) -> Ends:
        """(lower, upper), signed."""


class Pointwise(NamedTuple):
    """A formula without temporal operators that a leaf asks about: itself, and its value at a sample.

    `value` changes nothing and raises UndefinedError where there is no value.
    """

    psi: Formula
    value: Any


class Leaf:
    """A node that reads samples, at steps `start`..`stop` alone; its bounds `ends` cannot change at others.

    A sample is first read by all leaves, which may fail and changes nothing, and then taken by all, which cannot fail:
    a sample that is refused leaves no trace.

    Every leaf is a minimum at heart: F psi is -(G !psi), so a `flipped` leaf publishes its bounds negated and swapped.
    """

    def __init__(self, start: int, stop: int, flipped: bool) -> None:
        self.start, self.stop, self.flipped = start, stop, flipped
        self.ends: Ends

    def bounds(self) -> Ends:
        """(lower, upper), signed."""
        lower, upper = self.ends
        return (-upper, -lower) if self.flipped else (lower, upper)


L = TypeVar("L", bound=Leaf)


@dataclass(frozen=True)
class Joined:
    """Conjunction (`pick` is the least of a sequence) or disjunction (the greatest): bounds combine end by end."""

    parts: Sequence[Part]
    pick: Callable[[Sequence[Any]], Any]

    def bounds(self) -> Ends:
        """(lower, upper), signed."""
        ends = [part.bounds() for part in self.parts]
        return self.pick([lower for lower, _ in ends]), self.pick([upper for _, upper in ends])


@dataclass(frozen=True)
class Kit(Generic[L]):
    """What a tree is made of.

    Attributes:
        least, greatest: of a sequence of values.
        psi: (psi, names, negated) -> closure over a sample, for psi without temporal operators.
        lowest: (psi, (a, b), unknown, flipped) -> G[a,b] psi; `unknown` bounds psi at a sample not yet come.
        nested: (psi, (a, c), (d, e), unknown, flipped) -> F[a,c] G[d,e] psi.
        until: ((psi1, psi2), (a, b), (unknown1, unknown2), flipped) -> psi1 U[a,b] psi2.
        replayed: (formula, names, negated) -> any temporal formula.
    """

    least: Callable[[Sequence[Any]], Any]
    greatest: Callable[[Sequence[Any]], Any]
    psi: Callable[[Formula, tuple[str, ...], bool], Any]
    lowest: Callable[[Pointwise, Interval, Ends, bool], L]
    nested: Callable[[Pointwise, Interval, Interval, Ends, bool], L]
    until: Callable[[tuple[Pointwise, Pointwise], Interval, tuple[Ends, Ends], bool], L]
    replayed: Callable[[Formula, tuple[str, ...], bool], L]


class Tree(Generic[L]):
    """The cheapest operators that are exact for `formula`: `root` answers, `leaves` take the samples."""

    def __init__(self, formula: Formula, names: tuple[str, ...], kit: Kit[L]) -> None:
        self.kit, self.names = kit, names
        self.leaves: list[L] = []
        self.root = self._build(formula, False)

    def _build(self, formula: Formula, negated: bool) -> Part:
        if not is_temporal(formula):
            return self._lowest(formula, (0, 0), negated, False)
        kit = self.kit
        match formula:
            case Not(arg):
                return self._build(arg, not negated)
            case And() | Or():
                parts = [self._build(arg, negated) for arg in _together(formula)]
                return Joined(parts, kit.least if isinstance(formula, And) is not negated else kit.greatest)
            case Implies(left, right):
                parts = [self._build(left, not negated), self._build(right, negated)]
                return Joined(parts, kit.least if negated else kit.greatest)
            case _:
                return self._temporal(formula, negated)

    def _temporal(self, formula: Formula, negated: bool) -> Part:
        match formula:
            case Always(a, b, psi) if not is_temporal(psi):
                return self._lowest(psi, (a, b), False, negated)
            case Eventually(a, b, psi) if not is_temporal(psi):
                return self._lowest(psi, (a, b), True, not negated)
            case Always(a, c, Always(d, e, psi)) if not is_temporal(psi):
                return self._lowest(psi, _added((a, c), (d, e)), False, negated)
            case Eventually(a, c, Eventually(d, e, psi)) if not is_temporal(psi):
                return self._lowest(psi, _added((a, c), (d, e)), True, not negated)
            case Eventually(a, c, Always(d, e, psi)) if not is_temporal(psi):
                return self._nested(psi, (a, c), (d, e), False, negated)
            case Always(a, c, Eventually(d, e, psi)) if not is_temporal(psi):
                return self._nested(psi, (a, c), (d, e), True, not negated)
            case Until(a, b, left, right) | Release(a, b, left, right) if not (is_temporal(left) or is_temporal(right)):
                opposite = isinstance(formula, Release)  # a release is the opposite of an until of the opposites
                (first, before), (second, after) = self._psi(left, opposite), self._psi(right, opposite)
                return self._leaf(self.kit.until((first, second), (a, b), (before, after), negated is not opposite))
            case _:
                return self._leaf(self.kit.replayed(formula, self.names, negated))

    def _lowest(self, psi: Formula, interval: Interval, negated: bool, flipped: bool) -> Part:
        run, ends = self._psi(psi, negated)
        return self._leaf(self.kit.lowest(run, interval, ends, flipped))

    def _nested(self, psi: Formula, outer: Interval, inner: Interval, negated: bool, flipped: bool) -> Part:
        if inner[1] == END:  # of the windows that all reach on for ever the last one asks least; the first reads most
            windows = [self._lowest(psi, (start, END), negated, flipped) for start in outer]
            return Joined(windows, self.kit.least if flipped else self.kit.greatest)
        run, ends = self._psi(psi, negated)
        return self._leaf(self.kit.nested(run, outer, inner, ends, flipped))

    def _psi(self, psi: Formula, negated: bool = False) -> tuple[Pointwise, Ends]:
        """`psi` or its negation, and its bounds at a sample that has not come yet."""
        asked = Not(psi) if negated else psi
        lower, upper = (unknown(asked, self.names, compile_signed, worst) for worst in (True, False))
        return Pointwise(psi, self.kit.psi(psi, self.names, negated)), (lower, upper)

    def _leaf(self, leaf: L) -> L:
        self.leaves.append(leaf)
        return leaf


def _together(formula: And | Or) -> Sequence[Formula]:
    """The operands; those of an `&` that are G[a,b] psi with the same interval as one, and of an `|` those with F.

    So thousands of conjuncts are a few operators.
    """
    kind, window = (And, Always) if isinstance(formula, And) else (Or, Eventually)
    now, windows, others = list[Formula](), dict[Interval, list[Formula]](), list[Formula]()
    for arg in formula.args:
        if not is_temporal(arg):
            now.append(arg)
        elif isinstance(arg, window) and not is_temporal(arg.arg):
            windows.setdefault((arg.a, arg.b), []).append(arg.arg)
        else:
            others.append(arg)
    if formula.depth >= MAX_DEPTH - 1:
        return formula.args
    joined = [window(a, b, _one(kind, psis)) for (a, b), psis in windows.items()]
    return [*([_one(kind, now)] if now else []), *joined, *others]


def _one(kind: type[And | Or], psis: Sequence[Formula]) -> Formula:
    return kind(tuple(psis)) if len(psis) > 1 else psis[0]


def last_step(formula: Formula) -> int:
    """The last step that `formula` reads at t = 0: its horizon, or `END`."""
    return END if unbounded(formula) is not None else horizon(formula)


def _added(outer: Interval, inner: Interval) -> Interval:
    """The interval of G G or F F as one operator."""
    return outer[0] + inner[0], END if END in (outer[1], inner[1]) else outer[1] + inner[1]
