"""Proof that every function and every quotient has a value all over a box."""

from __future__ import annotations

from dataclasses import replace

from stlbench.stl.boxes.extremes import Search
from stlbench.stl.errors import UndefinedError
from stlbench.stl.functions.table import FUNCTIONS, Domain
from stlbench.stl.language.syntax import Binary, Call, Expression, Formula, Signal
from stlbench.stl.language.traversal import walk

#: boxes examined to tell an argument that touches the end of its domain from one that leaves it
TOUCHING = 20_000
_NOT_0 = Domain("other than 0", lambda low, high: low <= 0 <= high)


def with_proven_domains(psi: Formula, search: Search) -> Search:
    """The search with the ranges of all arguments that have a domain, inner ones first, for all of which it pays once.

    Raises:
        UndefinedError: an argument may leave its domain. One that touches the end of a closed domain, as in
            sqrt(1 - x * x) on [-1, 1], may do so by the tolerance in the proof, but at no point that is looked at.
    """
    limited = _limited(psi)
    count = max(1, len(limited))
    share = replace(search, boxes=search.boxes // count, work=search.work // count)
    for (arg, domain), whole in reversed(limited.items()):
        share.proven[arg] = _proven(arg, domain, whole, share)
    return replace(search, proven=share.proven)


def _limited(psi: Formula) -> dict[tuple[Expression, Domain], Expression]:
    """Arguments that have a domain, each with where it stands, outer ones first. The compiler checks constants."""
    limited: dict[tuple[Expression, Domain], Expression] = {}
    for node in walk(psi):
        match node:
            case Call(name, (arg,)) if (domain := FUNCTIONS[name].domain) is not None:
                limited[arg, domain] = node
            case Binary("/", _, divisor):
                limited[divisor, _NOT_0] = node
    return {key: node for key, node in limited.items() if any(isinstance(part, Signal) for part in walk(key[0]))}


def _proven(arg: Expression, domain: Domain, whole: Expression, search: Search) -> tuple[float, float]:
    lowest, highest = search.extremes(arg)
    low, high = -lowest.bound, highest.bound
    if not domain.may_leave(low, high):
        return low, high
    least = domain.least
    touches = least is not None and low >= least - search.tolerance
    if least is None or not touches or search.falls_below(arg, least, min(TOUCHING, search.boxes)):
        raise UndefinedError(
            f"{whole} is not defined all over the box: {arg} must be {domain.words} and may be from {low:g} to {high:g}"
        )
    return max(low, least), max(high, least)
