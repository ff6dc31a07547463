"""A form of a formula that more methods take: those of one outer operator over a window, and those of terms (eq. 2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from stlbench import stl
from stlbench.stl import Always, And, Eventually, Formula, Or
from stlbench.stl.language.structure import is_temporal


def regular(formula: Formula) -> Formula:
    """The formula in a form that more methods take.

    - Inside of F or G, a part without temporal operators beside others becomes G[0,0] of it. This is the same formula.
    - G[0,b] p & G[0,a] phi with b > a becomes G[0,a] (phi & G[0,b-a] p), where phi is temporal and p is not. This is
      the same formula.
    - Inside of F or G, G[c,d] p | G[c,d] q becomes G[c,d] (p | q). Every trace that satisfies the first satisfies the
      second, but not the other way round.
    """
    if isinstance(formula, And):
        args = tuple(map(regular, formula.args))
        joined = _joined(args)
        return replace(formula, args=args) if joined is None else joined
    if isinstance(formula, Always | Eventually):
        return replace(formula, arg=_inner(formula.arg))
    return formula


def _joined(args: Sequence[Formula]) -> Formula | None:
    """Two invariants as one, where one of them is temporal inside and ends first; None where they are not such."""
    if len(args) != 2 or not all(isinstance(arg, Always) and arg.a == 0 for arg in args):
        return None
    first, second = args
    assert isinstance(first, Always)
    assert isinstance(second, Always)
    plain, nested = (second, first) if is_temporal(first.arg) else (first, second)
    if is_temporal(plain.arg) or not is_temporal(nested.arg) or plain.b <= nested.b:
        return None
    return replace(nested, arg=And((nested.arg, Always(0, plain.b - nested.b, plain.arg))))


def _inner(formula: Formula) -> Formula:
    """The operand of F or G."""
    match formula:
        case Or(args) if all(isinstance(arg, Always) for arg in args):
            windows = [arg for arg in args if isinstance(arg, Always)]
            alike = len({(arg.a, arg.b) for arg in windows}) == 1 and not any(is_temporal(arg.arg) for arg in windows)
            return Always(windows[0].a, windows[0].b, Or(tuple(arg.arg for arg in windows))) if alike else formula
        case And(args) if is_temporal(formula):
            plain = [arg for arg in args if not is_temporal(arg)]
            rest = [regular(arg) for arg in args if is_temporal(arg)]
            held = [Always(0, 0, plain[0] if len(plain) == 1 else And(tuple(plain)))] if plain else []
            return And((*rest, *held))
        case _:
            return regular(formula) if stl.is_temporal(formula) else formula
