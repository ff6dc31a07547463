"""What the steps to come, and those that are not decided, may still add to a goal: names of bounds after the lines."""

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeGuard

from stlbench.stl.language.structure import is_temporal, negations_inside, operands_of, walk
from stlbench.stl.language.syntax import (
    END,
    Always,
    Between,
    Connective,
    Formula,
    Historically,
    Not,
    Once,
    Prefix,
    Since,
)
from stlbench.stl.predicates.writer import block
from stlbench.stl.recorded.evaluator import unknown
from stlbench.stl.running.pulling import During, Goal, all_of, conjuncts, later
from stlbench.stl.running.streams import Stream, Streams
from stlbench.stl.running.tree import UnsupportedError


class Coming(NamedTuple):
    """Steps after sample `now` that count, `start`..`stop`, and whether the `least` value there is asked for."""

    now: int
    start: int
    stop: int
    least: bool

    @property
    def any(self) -> bool:
        return self.now < self.stop

    @property
    def next(self) -> bool:
        """Whether the next step is one of them."""
        return self.start <= self.now + 1 <= self.stop


class Ahead:
    """The bounds of goals beside their decided steps; writes the streams that these need.

    Attributes:
        turns: samples at which the statements change.
        quiet: where this holds nothing begins or has begun, if there is one queue.
    """

    def __init__(self, streams: Streams) -> None:
        self.streams = streams
        self.turns, self.quiet = set[int](), ""
        self._since: dict[tuple[Formula, int], str] = {}
        self._open = dict[Goal, tuple[str, Formula | None]]()

    def least(self, goal: Goal, now: int, lines: list[str]) -> str:
        """The best of the least values at the steps after `now`."""
        return self._best(goal.psi, Coming(now, goal.start, goal.stop, True), lines)

    def greatest(self, goal: Goal, delay: int, now: int, lines: list[str]) -> str:
        """The best of the greatest values at the steps after `now` - `delay`; maybe decided ones count too."""
        ahead = self._best(goal.psi, Coming(now, goal.start, goal.stop, False), lines)
        if delay == 0 or ahead == "inf" or now >= later(goal.stop, delay):
            return ahead
        if goal not in self._open:
            raise UnsupportedError
        queue, before = self._open[goal]
        lines.append(f"{(name := self.streams.name('s'))} = {queue}[-1][0] if {queue} else -inf")
        return self.folded([ahead, name, *([] if before is None else [self._now(before, now)])], False, lines)

    def held(self, goal: Goal, best: str) -> Stream | None:
        """psi & G[a,b] q as a stream, if the goal is such a conjunction: its value where it is decided, else -inf.

        A queue has the begun ones that may still be better than `best`. What began later is worth more, since q cuts
        them all alike; so they are few, unless psi rises for a long time.
        """
        windows = [arg for arg in conjuncts(goal.psi) if _is_window(arg)]
        rest = [arg for arg in conjuncts(goal.psi) if not _is_window(arg)]
        if len({(arg.a, arg.b) for arg in windows}) != 1 or any(map(latest, rest)):
            return None
        (a, b), q = (windows[0].a, windows[0].b), [arg.arg for arg in windows]
        first, last, width = goal.start + a, later(goal.stop, a), b if b == END else b - a
        begun = [Once(a, a, all_of(rest))] if a > 0 and rest else rest
        guard, value = (self.streams.stream(all_of(parts), first) for parts in (q, [*q, *begun]))
        queue, name, v, w = self.streams.state("queue", "deque()"), self.streams.name("s"), guard.value, value.value
        cut = [
            "first = queue.pop()",
            f"while queue and queue[-1][0] >= {v}: first = queue.pop()",
            f"queue.append(({v}, first[1]))",
        ]
        more = "else" if w == v else f"elif {w} > (queue[-1][0] if queue else {best})"
        for begin, end, append in ((first, last, [f"{more}: queue.append(({w}, now))"]), (last + 1, END, [])):
            better = [
                f"queue = {queue}",
                *block(f"if queue and queue[-1][0] >= {v}", cut),
                *append,
                f"if queue and queue[0][1] == now - {width}: {name} = queue.popleft()[0]",
            ]
            lines = [f"{name} = -inf", *block(f"if {v} > {best}", better), f"elif {queue}: {queue}.clear()"]
            if begin <= END:
                self.streams.write(begin, lines, end)
        self.quiet = f"{v} <= {best} and not {queue}"
        if (goal.start, goal.stop) != (0, END):
            rest.append(During(goal.start, goal.stop))
        self._open[goal] = queue, Once(0, a - 1, all_of(rest)) if a > 0 and rest else None
        return Stream(name, b, first)

    # ------------------------------------------------------------------------------------------------- steps to come

    def _best(self, psi: Formula, at: Coming, lines: list[str]) -> str:
        """The best of the least or the greatest values of psi at steps to come.

        An operator of the past has one value at all of them, or its greatest one at the last, and its least one at the
        next. Of such that have their best elsewhere one at most stands in a conjunction.
        """

        def of(arg: Formula, start: int = 0) -> str:
            return self._best(arg, at._replace(start=start), lines)

        self.turns |= {at.start - 1, at.stop}
        match psi:
            case _ if not at.any:
                return "-inf"
            case During(_, last):
                self.turns.add(last)
                return "inf" if at.now < last else "-inf"
            case Not(arg):
                return self.negative(self._best(arg, at._replace(least=not at.least), lines), lines)
            case Connective():
                args = operands_of(psi)
                moving = [arg for arg in args if _has_interval(arg) and not (_is_window(arg) or _is_before(arg))]
                if psi.least and len(moving) > 1 and any(map(_may_be_best_early, moving)):
                    raise UnsupportedError
                for during in (arg for arg in args if psi.least and isinstance(arg, During)):
                    at = at._replace(start=max(at.start, during.first), stop=min(at.stop, during.last))
                return self.folded([self._best(arg, at, lines) for arg in args], psi.least, lines)
            case _ if psi in self.streams.parts or _is_window(psi):
                return "-inf" if at.least else "inf"
            case Prefix() if psi.past:
                return self._best_of_past(psi, at, lines)
            case Since(0, b, left, right) if not (_has_interval(left) or _has_interval(right)):
                ends = of(left), of(right)
                if b == END:
                    return self.folded([ends[1], self.folded([self._so_far(psi), ends[0]], True, lines)], False, lines)
                if ends == ("-inf", "-inf") if at.least else ends[1] == "inf":
                    return ends[1]
        match psi:
            case Since(_, b, left, right) if not (at.least or is_temporal(left)) and _is_masked(right):
                known = [self._now(Since(0, b if b == END else b - 1, left, right), at.now)] if b > 0 else []
                return self.folded([*known, of(right)], False, lines)
            case _:
                raise UnsupportedError

    def _best_of_past(self, psi: Prefix, at: Coming, lines: list[str]) -> str:
        a, b, arg = psi.a, psi.b, psi.arg
        if a == b == 1:
            known = [self._now(arg, at.now, "inf" if psi.least else "-inf")] if at.next else []
            at = at._replace(start=max(0, at.start - 1), stop=later(at.stop, -1))
            return self.folded([*known, self._best(arg, at, lines)], False, lines)
        if arg in self.streams.parts and a <= 1 and b < END:
            return self._best_of_window(psi, at)
        ahead = self._best(arg, at._replace(start=0), lines)
        if b == END and not (psi.least and _has_interval(arg)):
            return self.folded([self._so_far(psi), ahead], psi.least, lines)
        if at.least or psi.least or not _is_masked(arg):
            raise UnsupportedError
        return self.folded([*([self._now(Once(0, b - 1, arg), at.now)] if b > 0 else []), ahead], False, lines)

    def _best_of_window(self, psi: Prefix, at: Coming) -> str:
        """The same of H[a,b] and O[a,b] of a part without temporal operators, a <= 1, at some step to come."""
        last = later(at.stop, -psi.a)
        self.turns.add(last)
        if psi.least and not at.least:
            return self._least_since(psi, at.stop - psi.b) if at.stop < END else "inf"
        if not (psi.least or at.least) and at.now < last:
            return "inf"
        if psi.b == 0 or (psi.least and not (at.next and psi.a > 0)):
            return "-inf"
        return self._now(type(psi)(0, psi.b - 1, psi.arg), at.now, "inf" if psi.least else "-inf")

    def _now(self, psi: Formula, now: int, before: str = "-inf") -> str:
        """The value of psi at the sample `now`; before the first `before`, and -inf before psi has one."""
        first = lo = 0
        if psi in self.streams.parts:
            first = lo = self.streams.parts[psi].since
        elif isinstance(psi, Prefix) and psi.arg in self.streams.parts:
            first = self.streams.parts[psi.arg].since
            lo = later(first, psi.b)
        stream = self.streams.stream(psi, lo)
        if stream.delay:
            raise UnsupportedError
        return stream.value if now >= first else before if now < 0 == first else "-inf"

    def _so_far(self, psi: Formula) -> str:
        if psi not in self.streams.states:
            raise UnsupportedError
        return self.streams.states[psi]

    def _least_since(self, psi: Prefix, first: int) -> str:
        """The least value of the operand from a step on, which is the extreme of the last window."""
        key = psi, first
        if key not in self._since:
            state = self._since[key] = self.streams.state("so_far", "inf")
            arg = self.streams.stream(psi.arg, max(0, first))
            self.streams.write(max(0, first), [f"if {arg.value} < {state}: {state} = {arg.value}"])
        return self._since[key]

    def negative(self, value: str, lines: list[str]) -> str:
        if value in ("inf", "-inf"):
            return "inf" if value == "-inf" else "-inf"
        lines.append(f"{(name := self.streams.name('s'))} = -{value}")
        return name

    def folded(self, values: Sequence[str], least: bool, lines: list[str]) -> str:
        """The least or the greatest of names and infinities."""
        neutral, absorbing = ("inf", "-inf") if least else ("-inf", "inf")
        names = [value for value in dict.fromkeys(values) if value != neutral]
        if absorbing in names or not names:
            return absorbing if names else neutral
        return self.streams.pick(names, least, lines)


def _is_window(psi: Formula) -> TypeGuard[Always]:
    """Whether it is G of something without temporal operators."""
    return isinstance(psi, Always) and not is_temporal(psi.arg)


def _is_before(psi: Formula) -> bool:
    """Whether it is what has held so far at the step before."""
    match psi:
        case Historically(1, 1, Historically() as so_far):
            return not _has_interval(so_far)
        case _:
            return False


def _is_masked(psi: Formula) -> bool:
    return any(isinstance(node, During) for node in walk(psi))


def _may_be_best_early(psi: Formula) -> bool:
    """Whether the greatest value of psi may be at another step to come than the last."""
    return _is_masked(psi) or any(
        isinstance(node, Prefix) and node.a == node.b == 1 and is_temporal(node.arg) and not _is_before(node)
        for node in walk(psi)
    )


def _has_interval(psi: Formula) -> bool:
    return any(isinstance(node, Prefix | Between) and node.b < END for node in walk(psi))


# ------------------------------------------------------------------------------------------------------- what is known


def earliest(psi: Formula) -> float:
    """How many steps after t nothing is known: the least value of psi at t is -inf before sample t + `earliest`.

    `psi` has its negations at its parts without temporal operators, which can have any value.
    """
    match psi:
        case Not(Since(0, _, _, right)):
            return earliest(negations_inside(Not(right)))
        case Connective() if is_temporal(psi):
            return (max if psi.least else min)(earliest(arg) for arg, _ in psi.signed)
        case Prefix(a, b, arg) if psi.past:
            known = earliest(arg)
            if psi.least:
                return known if a == 0 else -math.inf
            return known if known == math.inf else known - _steps(b)
        case Prefix(a, b, arg):
            return earliest(arg) + (_steps(b) if psi.least else a)
        case Since(0, b, left, right):
            return min(earliest(left), earliest(right)) if b > 0 else earliest(right)
        case Between():
            return -math.inf
        case _:
            return 0.0


def latest(psi: Formula) -> float:
    """How many steps after t all is known."""
    inner = max((latest(arg) for arg in psi.operands if isinstance(arg, Formula)), default=0.0)
    if isinstance(psi, Prefix | Between):
        return (
            max(0.0, inner - psi.a)
            if psi.past and not isinstance(psi, Since)
            else inner + _steps(0 if psi.past else psi.b)
        )
    return inner


def rises(psi: Formula) -> bool:
    """Whether the greatest value of psi is inf at all steps that are far enough ahead; psi as in `earliest`."""
    match psi:
        case During(_, last):
            return last == END
        case Not(Since(0, b, left, right)):
            ends = [right] if b < END else [left, right]
            return all(rises(negations_inside(Not(end))) for end in ends)
        case Connective():
            return (all if psi.least else any)(rises(arg) for arg, _ in psi.signed)
        case Prefix(_, b, arg):
            return rises(arg) and not (psi.past and psi.least and b == END)
        case Between(_, _, _, right):
            return rises(right)
        case _:
            return True


def varies(psi: Formula, names: tuple[str, ...]) -> bool:
    """Whether psi, without temporal operators, can have any value at a step to come."""
    return (unknown(psi, names, "signed", True), unknown(psi, names, "signed", False)) == (-math.inf, math.inf)


def _steps(end: int) -> float:
    return math.inf if end == END else end
