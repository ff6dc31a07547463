"""A formula becomes plans: events and held conditions at symbolic steps, with linear constraints on these.

Each rule is sound. `_hold` has a formula at every step of an interval, `_some` at one step of it. Every plan that they
give implies the formula, whatever values its variables take within its rows. The plans are alternatives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import chain, islice, pairwise

from stlbench import stl
from stlbench.stl import Always, And, Eventually, Formula, Historically, Not, Once, Or, Release, Since, Term, Until
from stlbench.stl.errors import shorten
from stlbench.stl.language.structure import is_temporal, negations_inside, unbounded
from stlbench.stl.language.syntax import END, Between, Prefix


@dataclass(frozen=True)
class At:
    """A step of an episode: a number, or a variable plus a number."""

    offset: int
    variable: int | None = None

    def __add__(self, steps: int) -> At:
        return replace(self, offset=self.offset + steps)

    def since_start(self, steps: int) -> At:
        """This step plus `steps`, which may be negative; step 0 where a number would be before it."""
        if steps <= -END:  # the past without an interval
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
class _Asked:
    """`psi` at some step of `low`..`high` and for `stay` steps after it, or at each step where `stay` is None."""

    psi: Formula
    stay: int | None
    low: At
    high: At

    def excludes(self, other: _Asked) -> bool:
        """Whether one of the two asks for `psi`, and the other for its opposite all that time."""
        held, event = (self, other) if self.stay is None else (other, self)
        ends = held.low, event.low, event.high, held.high
        offsets = [at.offset for at in ends]
        inside = len({at.variable for at in ends}) == 1 and offsets == sorted(offsets)
        return held.stay is None and inside and held.psi == negations_inside(Not(event.psi))


@dataclass(frozen=True)
class Plan:
    """Events and held conditions that together imply a formula, for all values of variables that keep the rows."""

    variables: int = 0
    rows: tuple[tuple[At, At], ...] = ()
    """Pairs of an earlier step and a later one, which may be equal."""
    events: tuple[Event, ...] = ()
    held: tuple[Held, ...] = ()
    asked: frozenset[_Asked] = frozenset()
    """The events and held conditions so far, with the intervals that the formula gives them."""

    def ordered(self, *steps: At) -> Iterator[Plan]:
        """The plan with the steps in this order; none if two of them cannot be."""
        rows = list[tuple[At, At]]()
        for earlier, later in pairwise(steps):
            if earlier.variable != later.variable:
                rows.append((earlier, later))
            elif earlier.offset > later.offset:
                return
        yield replace(self, rows=(*self.rows, *rows)) if rows else self

    def variable(self) -> tuple[Plan, At]:
        """The plan with one more variable, and the step that it is."""
        return replace(self, variables=self.variables + 1), At(0, self.variables)

    def window(self, low: At, high: At) -> Iterator[tuple[Plan, At, At]]:
        """The plan with a window of two new variables within `low`..`high`, and its ends."""
        plan, begin = self.variable()
        plan, end = plan.variable()
        for each in plan.ordered(low, begin, end, high):
            yield each, begin, end

    def event(self, psi: Formula, stay: int, low: At, high: At) -> Iterator[Plan]:
        """The plan with an event that begins within `low`..`high`."""
        if (known := _constant(psi)) is not None:
            yield from (plan for plan, _, _ in self.window(low, high) if known)
            return
        asked = _Asked(psi, stay, low, high)
        if asked in self.asked:
            yield self
        elif not any(map(asked.excludes, self.asked)):
            for plan, begin, end in self.window(low, high):
                events = (*plan.events, Event(psi, stay, begin, end))
                yield replace(plan, events=events, asked=plan.asked | {asked})

    def holding(self, psi: Formula, low: At, high: At) -> Iterator[Plan]:
        """The plan with a condition that is held."""
        if (known := _constant(psi)) is not None:
            # one that never holds may still be held at no step at all
            yield from [self] if known else self.ordered(high + 1, low)
            return
        asked = _Asked(psi, None, low, high)
        if asked in self.asked:
            yield self
        elif not any(map(asked.excludes, self.asked)):
            yield replace(self, held=(*self.held, Held(psi, low, high)), asked=self.asked | {asked})

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
    return None if stl.signals(psi) else bool(stl.satisfied(psi, [[0.0]], ("any",)))


MOST_PLANS = 400  # alternatives of one formula that are looked at: each `or` may double their number
MOST_VISITS = 12
"""Visits of one region by which an F inside of G is served. Methods learned nothing from more, at equal intervals."""

_Plans = Iterator[Plan]
_Step = Callable[[Plan], _Plans]


def fewest_visits(span: int, width: int) -> int:
    """How often G over `span` steps asks for a single step of F over `width` steps inside of it."""
    return max(1, 1 + -(-(span - width) // (width + 1)))


class UnscheduledError(ValueError):
    """A formula has no schedule; the message names the operator, or the events, and the reason."""


def plans(formula: Formula, last: int) -> tuple[Plan, ...]:
    """The alternatives of a formula at step 0, the simplest first, with all samples at steps 0..`last`.

    Args:
        formula: intervals in steps.
        last: the last step of an episode.

    Raises:
        UnscheduledError: an operator looks ahead without an interval.
    """
    if (operator := unbounded(formula)) is not None:
        place = f" at {operator.position}" if operator.position else ""
        raise UnscheduledError(f"{operator.letter} without an interval{place} has no deadline; give it one, [a,b]")
    found = islice(_hold(Plan(), negations_inside(formula), At(0), At(0)), MOST_PLANS)
    return tuple(each for plan in found for each in _within(plan, At(last)))


def _within(plan: Plan, last: At) -> _Plans:
    """The plan with all its samples up to the last step."""
    ends = [event.end + event.stay for event in plan.events] + [held.end for held in plan.held]
    return _all(plan, [lambda each, end=end: each.ordered(end, last) for end in ends])  # type: ignore[misc]


def _all(plan: Plan, steps: Sequence[_Step]) -> _Plans:
    """The plan with all of the steps taken; each may have alternatives."""
    return reduce(lambda found, step: chain.from_iterable(map(step, found)), steps, iter([plan]))


def _holds(formula: Formula, low: At, high: At) -> _Step:
    return lambda plan: _hold(plan, formula, low, high)


def _happens(formula: Formula, low: At, high: At) -> _Step:
    return lambda plan: _some(plan, formula, low, high)


def _before(*steps: At) -> _Step:
    return lambda plan: plan.ordered(*steps)


def _hold(plan: Plan, formula: Formula, low: At, high: At) -> _Plans:
    """The formula at every step of `low`..`high`."""
    if high.variable is None and high.offset < 0:
        return iter([plan])  # nothing is asked of steps before 0
    if not is_temporal(formula):
        return plan.holding(formula, low, high)
    match formula:
        case And(args):
            return _all(plan, [_holds(arg, low, high) for arg in args])
        case Or(args):
            return chain(
                chain.from_iterable(_hold(plan, arg, low, high) for arg in args), _in_turn(plan, args, low, high)
            )
        case Always(arg=arg) | Historically(arg=arg):
            first, last = _interval(formula)
            return _hold(plan, arg, low.since_start(first), high + last)
        case Eventually(arg=arg) | Once(arg=arg):
            return _Service(arg, *_interval(formula)).over(plan, low, high)
        case Until(left=left, right=right) | Since(left=left, right=right):
            return _Service(right, *_interval(formula), left, formula.past).over(plan, low, high)
        case Release(a, b, left, right):
            return _released(plan, left, right, low, high, (a, b))
        case Not(Since(a, b, left, right)):
            return _not_since(plan, negations_inside(Not(left)), negations_inside(Not(right)), low, high, (a, b))
    raise UnscheduledError(f"no schedule is known for {shorten(str(formula))}")


def _some(plan: Plan, formula: Formula, low: At, high: At) -> _Plans:
    """The formula at some step of `low`..`high`."""
    if high.variable is None and high.offset < 0:
        return iter(())
    if not is_temporal(formula):
        return plan.event(formula, 0, low, high)
    if low.variable is not None and low.offset < 0:  # an operator must not look ahead from before step 0
        plan, begin = plan.variable()
        return _all(plan, [_before(low, begin, high), _happens(formula, begin, high)])
    match formula:
        case Or(args):
            return chain.from_iterable(_some(plan, arg, low, high) for arg in args)
        case Eventually(arg=arg) | Once(arg=arg):
            first, last = _interval(formula)
            return _some(plan, arg, low.since_start(first), high + last)
        case Always(a, b, arg) if not is_temporal(arg):
            return plan.event(arg, b - a, low + a, high + a)
        case Historically(a, b, arg) if not is_temporal(arg) and b != END:
            return plan.event(arg, b - a, low.since_start(-b), high + -b)
        case And(args) if any(not is_temporal(arg) for arg in args):
            return _event_with(plan, args, low, high)
        case _:
            plan, step = plan.variable()
            return _all(plan, [_before(low, step, high), _holds(formula, step, step)])


def _event_with(plan: Plan, args: Sequence[Formula], low: At, high: At) -> _Plans:
    """An event of the parts without temporal operators. The others hold all along its window: it may be anywhere."""
    plain = [arg for arg in args if not is_temporal(arg)]
    psi = plain[0] if len(plain) == 1 else And(tuple(plain))
    for each, begin, end in plan.window(low, high):
        rest = [_holds(arg, begin, end) for arg in args if is_temporal(arg)]
        yield from _all(each, [_happens(psi, begin, end), *rest])


def _interval(operator: Prefix | Between) -> tuple[int, int]:
    """The first and the last step that an operator at step 0 reads; negative ones of the past."""
    return (-operator.b, -operator.a) if operator.past else (operator.a, operator.b)


@dataclass(frozen=True)
class _Service:
    """`psi` within t + first..t + last for every step t of an interval; until then, or since then, `guard`."""

    psi: Formula
    first: int
    last: int
    guard: Formula | None = None
    past: bool = False

    def over(self, plan: Plan, low: At, high: At) -> _Plans:
        yield from self._once(plan, low, high)
        yield from self._first(plan, low, high)
        yield from self._visits(plan, low, high)
        if low != high and self._fewest(low, high) <= MOST_VISITS:
            yield from self._always(plan, low, high)

    def _fewest(self, low: At, high: At) -> int:
        """The visits that it takes, if each is a single step; 1 where the interval has no known length."""
        known = low.variable == high.variable and self.first > -END
        return fewest_visits(high.offset - low.offset, self.last - self.first) if known else 1

    def _guarded(self, low: At, high: At, begin: At, end: At) -> list[_Step]:
        """The guard, where `psi` holds within `begin`..`end` first and last."""
        if self.guard is None:
            return []
        return [_holds(self.guard, begin + 1, high) if self.past else _holds(self.guard, low, end + -1)]

    def _once(self, plan: Plan, low: At, high: At) -> _Plans:
        """One window that serves all steps."""
        earliest, latest = high.since_start(self.first), low + self.last
        if self.guard is None:
            return _all(plan, [_before(earliest, latest), _happens(self.psi, earliest, latest)])
        return chain.from_iterable(
            _all(each, [_happens(self.psi, begin, end), *self._guarded(low, high, begin, end)])
            for each, begin, end in plan.window(earliest, latest)
        )

    def _first(self, plan: Plan, low: At, high: At) -> _Plans:
        """The guard or `psi` until the event: the guard until `psi` holds first. It serves `!A U[0,50] A`."""
        guard = self.guard
        if guard is None or self.past or self.first != 0 or low != high or is_temporal(guard) or is_temporal(self.psi):
            return iter(())
        return replace(self, guard=Or((guard, self.psi)))._once(plan, low, high)

    def _visits(self, plan: Plan, low: At, high: At) -> _Plans:
        """Windows one after the other: from the begin of each to the end of the next all steps are served."""
        if low.variable != high.variable or self.first <= -END:
            return
        fewest = self._fewest(low, high)
        for count in range(max(2, fewest), fewest + 2) if high.offset > low.offset else ():
            if count <= MOST_VISITS:
                yield from self._visited(plan, low, high, count)

    def _visited(self, plan: Plan, low: At, high: At, count: int) -> _Plans:
        windows = list[tuple[At, At]]()
        for _ in range(count):
            plan, begin = plan.variable()
            plan, end = plan.variable()
            windows.append((begin, end))
        first, last = windows[0], windows[-1]
        steps = [_before(low.since_start(self.first), first[0]), _before(first[1], low + self.last)]
        for (begin, end), (later, latest) in pairwise(windows):  # no gap, if one visit is early and the next is late
            steps += [_before(end + 1, later), _before(latest, begin + (self.last - self.first + 1))]
        steps += [_before(high + self.first, last[0]), _before(last[1], high + self.last)]
        steps += [_before(begin, end) for begin, end in windows]
        steps += [_happens(self.psi, begin, end) for begin, end in windows]
        return _all(plan, [*steps, *self._guarded(low, high, first[0], last[1])])

    def _always(self, plan: Plan, low: At, high: At) -> _Plans:
        """`psi` at the last step of each interval: G in place of G F."""
        begin, end = low + self.last, high + self.last
        exists = _before(At(0), begin)  # there is no sample before step 0
        return _all(plan, [exists, _holds(self.psi, begin, end), *self._guarded(low, high, begin, end)])


def _in_turn(plan: Plan, args: Sequence[Formula], low: At, high: At) -> _Plans:
    """Two parts of an `or`: one of them inside of a window, the other before it, after it, or both."""
    plain = tuple(arg for arg in args if not is_temporal(arg))
    parts = [
        *((plain if len(plain) == 1 else (Or(plain),)) if plain else ()),
        *(arg for arg in args if is_temporal(arg)),
    ]
    if len(parts) != 2 or low.variable is not None or high.variable is not None or low == high:
        return
    for outer, inner in (parts, parts[::-1]):
        wider, step = plan.variable()
        within = _before(low, step, high + 1)
        yield from _all(wider, [within, _holds(inner, low, step + -1), _holds(outer, step, high)])
        if is_temporal(outer) and is_temporal(inner):
            continue
        wider, begin = plan.variable()
        wider, end = wider.variable()
        middle = [_before(low, begin, end, high), _holds(inner, begin, end)]
        yield from _all(wider, [*middle, _holds(outer, low, begin + -1), _holds(outer, end + 1, high)])


def _released(plan: Plan, left: Formula, right: Formula, low: At, high: At, interval: tuple[int, int]) -> _Plans:
    """`left R right`: right all the time, or until left holds."""
    a, b = interval
    yield from _hold(plan, right, low + a, high + b)
    for each, begin, end in plan.window(high, high + b):
        yield from _all(each, [_happens(left, begin, end), _holds(right, low + a, end)])


def _not_since(plan: Plan, left: Formula, right: Formula, low: At, high: At, interval: tuple[int, int]) -> _Plans:
    """`!(p S q)`, with `left` for !p and `right` for !q: right all the time, or from a step at which left holds."""
    a, b = interval
    yield from _hold(plan, right, low.since_start(-b), high + -a)
    for each, begin, end in plan.window(At(0), low):
        yield from _all(each, [_happens(left, begin, end), _holds(right, begin, high + -a)])
