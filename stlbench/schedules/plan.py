"""A plan: events and held conditions at symbolic steps, with linear constraints on these."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from stlbench import stl
from stlbench.stl import And, Formula, Term
from stlbench.stl.language.syntax import END


@dataclass(frozen=True)
class At:
    """A step of an episode: a number, or a variable plus a number."""

    offset: int
    variable: int | None = None

    def __add__(self, steps: int) -> At:
        return replace(self, offset=self.offset + steps)

    def since_start(self, steps: int) -> At:
        """This step plus `steps`, which may be negative; step 0 where a number would be before it."""
        if steps <= -END:
            return At(0)
        moved = self + steps
        return At(max(0, moved.offset)) if self.variable is None else moved

    def of(self, values: Sequence[int]) -> int:
        """Its number, with the values of all variables."""
        return self.offset + (0 if self.variable is None else values[self.variable])


@dataclass(frozen=True)
class Event:
    """`psi` holds at all of t..t + `stay`, for some t in `begin`..`end`, which are variables of its own."""

    psi: Formula
    stay: int
    begin: At
    end: At


@dataclass(frozen=True)
class Held:
    """`psi` holds at each step of `begin`..`end`; at none where `end` is before `begin`."""

    psi: Formula
    begin: At
    end: At


@dataclass(frozen=True)
class Plan:
    """Events and held conditions that together imply a formula, for all values of variables that keep the rows."""

    variables: int = 0
    rows: tuple[tuple[At, At], ...] = ()
    """Pairs of an earlier step and a later one, which may be equal."""
    events: tuple[Event, ...] = ()
    held: tuple[Held, ...] = ()

    def ordered(self, *steps: At) -> Iterator[Plan]:
        """With the steps in this order; nothing where two of them cannot be."""
        rows = list[tuple[At, At]]()
        for earlier, later in pairwise(steps):
            if earlier.variable != later.variable:
                rows.append((earlier, later))
            elif earlier.offset > later.offset:
                return
        yield replace(self, rows=(*self.rows, *rows)) if rows else self

    def variable(self) -> tuple[Plan, At]:
        """With one more variable."""
        return replace(self, variables=self.variables + 1), At(0, self.variables)

    def window(self, low: At, high: At) -> Iterator[tuple[Plan, At, At]]:
        """With a window of two new variables within `low`..`high`."""
        plan, begin = self.variable()
        plan, end = plan.variable()
        for each in plan.ordered(low, begin, end, high):
            yield each, begin, end

    def event(self, psi: Formula, stay: int, low: At, high: At) -> Iterator[Plan]:
        """With an event that begins within `low`..`high`."""
        known = _constant(psi)
        for plan, begin, end in self.window(low, high) if known is not False else ():
            yield plan if known else replace(plan, events=(*plan.events, Event(psi, stay, begin, end)))

    def holding(self, psi: Formula, low: At, high: At) -> Iterator[Plan]:
        """With a condition that is held."""
        if (known := _constant(psi)) is not None:
            # one that never holds may still be held at no step at all
            yield from [self] if known else self.ordered(high + 1, low)
            return
        yield replace(self, held=(*self.held, Held(psi, low, high)))

    def terms(self, values: Sequence[int]) -> tuple[Term, ...]:
        """The terms of eq. 2 with the values of the variables, by their ends; those of no sample are left out."""
        terms = list[Term]()
        for event in self.events:
            begin, end = event.begin.of(values), event.end.of(values)
            fixed = Term("F", begin, end, 0, 0, event.psi)
            if event.stay:
                fixed = Term("FG", begin, event.stay, end, 0, event.psi)
            terms.append(fixed)
        for held in self.held:
            begin, end = max(0, held.begin.of(values)), held.end.of(values)
            if begin <= end:
                terms.append(Term("G", begin, end, 0, 0, held.psi))
        return tuple(sorted(dict.fromkeys(terms), key=lambda term: (term.kind == "G", term.end, term.start)))


def conjunction(terms: Sequence[Term]) -> Formula:
    """The formula of at least one term."""
    formulas = [term.formula for term in terms]
    return formulas[0] if len(formulas) == 1 else And(tuple(formulas))


def _constant(psi: Formula) -> bool | None:
    """Whether a formula without signals holds; None where it has signals."""
    if stl.signals(psi):
        return None
    return bool(stl.satisfied(psi, [[0.0]], ("any",)))
