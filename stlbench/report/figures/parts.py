"""The parts of a formula that have a region in pictures of signals: for any formula, also outside the fragment."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from stlbench import stl
from stlbench.stl import Always, And, Eventually, Formula, Or, Release, Until
from stlbench.task.task import Task


class Part(NamedTuple):
    """A part of a formula without temporal operators, as large as there is."""

    psi: Formula
    start: int
    """The first step at which it can be read."""
    end: int
    """The last."""
    operators: tuple[str, ...]
    """Those that it stands in, from outside: G[0,900], F[0,99]."""

    def __str__(self) -> str:
        return " ".join([*self.operators, str(self.psi)])


def parts(task: Task) -> tuple[Part, ...]:
    """The parts of the task's own formula, in their order; of one in the fragment of eq. 2, one per term.

    Negations and implications of temporal formulas are read with their negations inside.
    """
    return tuple(_parts(Part(task.formula, 0, 0, ())))


def _parts(within: Part) -> Iterator[Part]:
    formula = within.psi
    if not stl.is_temporal(formula):
        yield within
        return
    match formula:
        case And(args) | Or(args):
            for arg in args:
                yield from _parts(within._replace(psi=arg))
        case Always(a, b, arg) | Eventually(a, b, arg):
            yield from _parts(_inside(within, f"{formula.letter}[{a},{b}]", arg, a, b))
        case Until(a, b, left, right):
            yield from _parts(_inside(within, f"until U[{a},{b}]", left, 0, b))
            yield from _parts(_inside(within, f"U[{a},{b}]", right, a, b))
        case Release(a, b, left, right):
            yield from _parts(_inside(within, f"releases R[{a},{b}]", left, 0, b))
            yield from _parts(_inside(within, f"R[{a},{b}]", right, a, b))
        case _ if (pushed := stl.negations_inside(formula)) != formula:
            yield from _parts(within._replace(psi=pushed))
        case _:  # of the past, which has no steps of its own
            return


def _inside(within: Part, operator: str, arg: Formula, a: int, b: int) -> Part:
    return Part(arg, within.start + a, within.end + b, (*within.operators, operator))
