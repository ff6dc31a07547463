"""The parts of a formula that counters decide: chains of stages, and requests that wait for an answer."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, NoReturn

import numpy as np

from stlbench import stl
from stlbench.contract import Integers, Truth, Unsuitable
from stlbench.stl import Formula, is_temporal
from stlbench_methods.formula_parts import refuse_past


@dataclass(frozen=True)
class Reach:
    """Stages to be reached in turn: `guard` U[start,end] (s_1 & F[0,w_1] (s_2 & ... F[0,w_n-1] G[0,length-1] s_n))."""

    guard: Formula | None
    """The formula that has to hold until the first stage; None for F in place of U."""
    start: int
    end: int
    stages: tuple[Formula, ...]
    waits: tuple[int, ...]
    """The most steps from each stage to the next."""
    length: int = 1
    """Samples in a row at which the last stage has to hold."""

    @property
    def most(self) -> tuple[int, ...]:
        """The greatest numbers in its memory: the guard held so far, the time left after each stage, the last's run."""
        return (*(() if self.guard is None else (1,)), *self.waits, self.length)

    @property
    def needs(self) -> tuple[Formula | None, ...]:
        """Its formulas without temporal operators, in the order of `counter_kernels`."""
        return self.guard, *self.stages

    def __str__(self) -> str:
        waits = "".join(f", then within {wait}" for wait in self.waits)
        run = f", {self.length} in a row" if self.length > 1 else ""
        return f"{len(self.stages)} in turn from {self.start}..{self.end}{waits}{run}"


@dataclass(frozen=True)
class Answer:
    """Requests to be answered in time: G (request -> kept U[0,wait] answer), for requests at start..end.

    An answer is a run of `length` samples, and counts at its last sample.
    """

    request: Formula | None
    """None: each sample is a request."""
    kept: Formula | None
    """The formula that has to hold until the answer; None for F in place of U."""
    answer: Formula
    start: int
    end: int
    wait: int
    length: int = 1

    @property
    def most(self) -> tuple[int, ...]:
        """The greatest numbers in its memory: the run of the answer, if it is one; the age of the oldest request."""
        return (self.length, self.wait) if self.length > 1 else (self.wait,)

    @property
    def needs(self) -> tuple[Formula | None, ...]:
        """Its formulas without temporal operators, in the order of `counter_kernels`."""
        return self.request, self.kept, self.answer

    def __str__(self) -> str:
        run = f", {self.length} in a row" if self.length > 1 else ""
        return f"an answer within {self.wait} of each request at {self.start}..{self.end}{run}"


Duty = Reach | Answer

DONE, FAILED = -2, -1
"""States of a part, which take the place of the last number of its memory."""


class Tables(NamedTuple):
    """The parts of a formula, for compiled code. Part i has the numbers `first[i]` to `last[i]` of the memory."""

    chain: Truth  # (parts,): it is a `Reach`
    first: Integers  # (parts,)
    last: Integers  # (parts,)
    start: Integers  # (parts,)
    end: Integers  # (parts,)
    length: Integers  # (parts,)
    needs: Integers  # (parts,): the place in `which` at which its formulas begin
    which: Integers  # (needs,): the place of a formula among all; -1 if there is none
    most: Integers  # (m,): the greatest count of each number


def tables_of(parts: Sequence[Duty]) -> tuple[Tables, tuple[Formula, ...]]:
    """The tables, and the formulas whose truth they need, each once."""
    needs = [need for part in parts for need in part.needs]
    needed = tuple(dict.fromkeys(need for need in needs if need is not None))
    ends = np.cumsum([len(part.most) for part in parts])
    tables = Tables(
        chain=np.array([isinstance(part, Reach) for part in parts]),
        first=ends - [len(part.most) for part in parts],
        last=ends - 1,
        start=np.array([part.start for part in parts]),
        end=np.array([part.end for part in parts]),
        length=np.array([part.length for part in parts]),
        needs=np.cumsum([0, *(len(part.needs) for part in parts[:-1])]),
        which=np.array([-1 if need is None else needed.index(need) for need in needs]),
        most=np.array([most for part in parts for most in part.most]),
    )
    return tables, needed


def parts_of(formula: Formula) -> tuple[Duty, ...]:
    """The parts whose conjunction is the formula, intervals in steps.

    Raises `Unsuitable` if one counter for each operator does not decide it, with the operator, its place and why.
    """
    refuse_past(formula)
    try:
        stl.horizon(formula)
    except stl.UnboundedError as error:
        raise Unsuitable(str(error)) from error
    return tuple(_conjuncts(formula))


def _conjuncts(formula: Formula) -> list[Duty]:
    match phi := _simple(formula):
        case stl.And(args):
            return [part for arg in args for part in _conjuncts(arg)]
        case stl.Eventually(a, b, arg):
            return [_reach(None, a, b, arg)]
        case stl.Until(a, b, left, right):
            return [_reach(_plain(left, "left of U"), a, b, right)]
        case _:
            return _always(phi, 0, 0)


def _always(formula: Formula, a: int, b: int, request: Formula | None = None) -> list[Duty]:
    """G[a,b] (request -> formula)."""
    match phi := _simple(formula):
        case _ if not is_temporal(phi):
            held = phi if request is None else stl.Implies(request, phi)
            return [Reach(None, a, a, (held,), (), b - a + 1)]
        case stl.And(args):
            return [part for arg in args for part in _always(arg, a, b, request)]
        case stl.Implies(left, right) if not is_temporal(left):
            return _always(right, a, b, _both(request, left))
        case stl.Or(args):
            later = [arg for arg in args if is_temporal(_simple(arg))]
            if len(later) > 1:
                _refuse(later[1], "inside of G it stands beside another temporal part in a disjunction")
            now = tuple(stl.Not(_simple(arg)) for arg in args if arg is not later[0])
            return _always(later[0], a, b, _both(request, *now))
        case stl.Always(c, d, arg) if request is None:
            return _always(arg, a + c, b + d)
        case stl.Eventually(c, d, arg):
            return [_answered(phi, arg, (a, b), (c, d), request)]
        case stl.Until(c, d, left, right):
            return _kept(phi, _plain(left, "left of U"), _plain(right, "right of U, inside of G"), (a, b), request)
        case _:
            _refuse(phi, "counters take F, G and U, inside of G maybe after a request")


def _answered(
    eventually: Formula, goal: Formula, times: tuple[int, int], within: tuple[int, int], request: Formula | None
) -> Duty:
    """G[a,b] (request -> F[c,d] goal)."""
    (a, b), (c, d) = times, within
    inner = _simple(goal)
    if isinstance(inner, stl.Eventually):
        return _answered(eventually, inner.arg, times, (c + inner.a, d + inner.b), request)
    if c > 0 and request is not None:
        _refuse(eventually, "it begins later than the request, so that each open request would need a counter")
    if isinstance(inner, stl.Always) and request is None:
        delay, length = inner.b, inner.b - inner.a + 1
        held = _plain(inner.arg, "inside of G F G")
        return Answer(None, None, held, a + c + delay, b + c + delay, d - c, length)
    what = "inside of G F" if request is None else "in the answer to a request"
    return Answer(request, None, _plain(inner, what), a + c, b + c, d - c)


def _kept(
    until: stl.Until, left: Formula, right: Formula, times: tuple[int, int], request: Formula | None
) -> list[Duty]:
    """G[a,b] (request -> left U[c,d] right). If c > 0, left holds for c steps first."""
    a, b = times
    if until.a == 0:
        return [Answer(request, left, right, a, b, until.b)]
    if request is not None:
        _refuse(until, "it begins later than the request, so that each open request would need a counter")
    first = Reach(None, a, a, (left,), (), b + until.a - a)
    return [first, Answer(None, left, right, a + until.a, b + until.a, until.b - until.a)]


def _reach(guard: Formula | None, a: int, b: int, formula: Formula) -> Reach:
    """`guard` U[a,b] formula, a chain of stages."""
    stages, waits = list[Formula](), list[int]()
    phi = _simple(formula)
    if guard is None:  # the windows of operators in a row add up
        while isinstance(phi, stl.Eventually):
            a, b, phi = a + phi.a, b + phi.b, _simple(phi.arg)
        if isinstance(phi, stl.Always) and phi.a > 0:
            a, b, phi = a + phi.a, b + phi.a, stl.Always(0, phi.b - phi.a, phi.arg)
    while is_temporal(phi):
        now, later = _split(phi)
        if later.a > 0:
            _refuse(later, "it begins later than the stage before it, so that each visit of that would need a counter")
        if isinstance(later, stl.Always):
            held = _plain(later.arg, "the last stage of a chain")
            if now is not None:
                stages, waits = [*stages, now], [*waits, 0]
            return Reach(guard, a, b, (*stages, held), tuple(waits), later.b + 1)
        if now is None and stages:
            waits[-1] += later.b
        else:
            stages, waits = [*stages, stl.TrueFormula() if now is None else now], [*waits, later.b]
        phi = _simple(later.arg)
    return Reach(guard, a, b, (*stages, phi), tuple(waits))


def _split(phi: Formula) -> tuple[Formula | None, stl.Always | stl.Eventually]:
    """A stage of a chain: what holds now, if anything, and the operator for what comes later."""
    args = tuple(map(_simple, phi.args)) if isinstance(phi, stl.And) else (phi,)
    later = [arg for arg in args if is_temporal(arg)]
    if len(later) > 1:
        _refuse(later[1], "inside of F or U it stands beside another temporal part; a chain has one after each stage")
    if not isinstance(later[0], stl.Always | stl.Eventually):
        _refuse(later[0], "inside of F or U stand stages that follow each other by F, the last one maybe with G")
    now = tuple(arg for arg in args if not is_temporal(arg))
    return (_both(None, *now) if now else None), later[0]


def _simple(phi: Formula) -> Formula:
    """The formula without operators over the present sample alone, and with negations inside."""
    if isinstance(phi, stl.Not) and is_temporal(phi):
        phi = stl.negations_inside(phi)
    if isinstance(phi, stl.Implies) and is_temporal(phi.left):
        phi = stl.negations_inside(phi)
    while isinstance(phi, stl.Always | stl.Eventually) and phi.a == phi.b == 0:
        phi = _simple(phi.arg)
    if isinstance(phi, stl.And | stl.Or) and is_temporal(phi):
        return type(phi)(tuple(map(_simple, phi.args)), position=phi.position)
    return phi


def _both(first: Formula | None, *others: Formula) -> Formula:
    args = (*([] if first is None else [first]), *others)
    return args[0] if len(args) == 1 else stl.And(args)


def _plain(formula: Formula, where: str) -> Formula:
    """The formula, which has no temporal operators."""
    if is_temporal(phi := _simple(formula)):
        _refuse(phi, f"{where} stands what has no temporal operators")
    return phi


def _refuse(phi: Formula, reason: str) -> NoReturn:
    name = phi.operator if isinstance(phi, stl.Temporal) else type(phi).__name__.lower()
    place = f" at {phi.position}" if phi.position else ""
    raise Unsuitable(f"{name}{place}: {reason}")
