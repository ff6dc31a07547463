"""Nested and past formulas for one trace, as source: each operator turns the stream of its operand into its own.

A stream has the value of a formula at step t when sample t + delay has come, at constant amortised cost: windows are
monotone queues, since and the operators of the past without an interval are a number. `pulling` first makes operands
look back. Then F psi is the best of a stream so far, if nothing of psi is known before all of it is (`earliest`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from stlbench.stl.language.structure import is_temporal, negations_inside, operands_of, walk
from stlbench.stl.language.syntax import END, Between, Connective, Formula, Not, Since, Window
from stlbench.stl.predicates.writer import block


class UnsupportedError(Exception):
    """The formula has something that is known in part while it is still open."""


class Stream(NamedTuple):
    """The value of a formula at step t, `delay` samples later; from sample `since` on."""

    value: str  # a name
    delay: int
    since: int


class Lines(NamedTuple):
    """Statements that run at the samples first..last."""

    first: int
    last: int
    lines: list[str]


class Streams:
    """Writes streams; operator number n has its state in attributes of `m`, and temporaries, that end in n and a count.

    Attributes:
        begin: the statements that initialise the state.
        steps: the statements of a sample, in order.
        cuts: samples at which these change.
    """

    def __init__(self, number: int, parts: dict[Formula, Stream]) -> None:
        self.number, self.parts = number, parts
        self.begin: list[str] = []
        self.steps: list[Lines] = []
        self.states: dict[Formula, str] = {}  # of past operators without an interval
        self._known: dict[tuple[Formula, int], Stream] = {}
        self._names = 0

    def name(self, kind: str) -> str:
        self._names += 1
        return f"{kind}{self.number}_{self._names}"

    def state(self, kind: str, initial: str) -> str:
        name = f"m.{self.name(kind)}"
        self.begin.append(f"{name} = {initial}")
        return name

    def write(self, first: int, lines: Sequence[str], last: int = END) -> None:
        self.steps.append(Lines(first, last, list(lines)))

    # --- formulas

    def stream(self, psi: Formula, lo: int) -> Stream:
        """The stream of psi from step `lo` on."""
        if psi in self.parts:
            part = self.parts[psi]
            if part.since > lo:
                raise UnsupportedError
            return part
        if (psi, lo) not in self._known:
            self._known[psi, lo] = self._written(psi, lo)
        return self._known[psi, lo]

    def _written(self, psi: Formula, lo: int) -> Stream:
        match psi:
            case Connective():
                return self._joined(psi, lo)
            case Window() if psi.past:
                return self._past(psi, lo)
            case Window(a, b, arg) if b < END:
                inner = self.stream(arg, lo + a)
                return self._extreme(psi, inner, b - a + 1)._replace(delay=inner.delay + b, since=lo + inner.delay + b)
            case Since(0, b, left, right):
                return self._since(psi, b, left, right, lo)
            case _:
                raise UnsupportedError

    def _joined(self, psi: Connective, lo: int) -> Stream:
        streams = [self.stream(arg, lo) for arg, _ in psi.signed]
        delay = max(stream.delay for stream in streams)
        streams = [self._delayed(stream, delay) for stream in streams]
        since = max(stream.since for stream in streams)
        values = [
            f"-{stream.value}" if negated else stream.value
            for stream, (_, negated) in zip(streams, psi.signed, strict=True)
        ]
        return Stream(self.pick(values, psi.least, since), delay, since)

    def pick(self, values: Sequence[str], least: bool, since: int) -> str:
        """A name for the least or the greatest of some names, which may be negated."""
        lines, result = list[str](), ""
        for value in values:
            if value.startswith("-"):
                lines.append(f"{(negative := self.name('s'))} = {value}")
                value = negative
            if result:
                better = "<" if least else ">"
                lines.append(f"{(best := self.name('s'))} = {value} if {value} {better} {result} else {result}")
                value = best
            result = value
        self.write(since, lines)
        return result

    def _delayed(self, stream: Stream, delay: int) -> Stream:
        if (steps := delay - stream.delay) == 0:
            return stream
        line, name = self.state("line", "deque()"), self.name("s")
        push = f"{line}.append({stream.value})"
        self.write(stream.since, [push], stream.since + steps - 1)
        self.write(stream.since + steps, [push, f"{name} = {line}.popleft()"])
        return Stream(name, delay, stream.since + steps)

    def _past(self, psi: Window, lo: int) -> Stream:
        if psi.b == END:
            arg = self.stream(psi.arg, 0)
            state = self.states[psi] = self.state("so_far", "inf" if psi.least else "-inf")
            better = "<" if psi.least else ">"
            name = self.name("s")
            self.write(arg.since, [f"if {arg.value} {better} {state}: {state} = {arg.value}", f"{name} = {state}"])
            return Stream(name, arg.delay, lo + arg.delay)
        arg = self.stream(psi.arg, max(0, lo - psi.b))
        arg = self._delayed(arg, max(arg.delay, psi.a))
        delay = arg.delay - psi.a
        result = self._extreme(psi, arg, psi.b - psi.a + 1)._replace(delay=delay, since=lo + delay)
        if lo < psi.a:  # nothing of the interval is in the trace
            self.write(lo + delay, [f"{result.value} = {'inf' if psi.least else '-inf'}"], arg.since - 1)
        return result

    def _extreme(self, psi: Window, arg: Stream, width: int) -> Stream:
        """The extreme of the last `width` values of a stream, of as many as there are at first."""
        if width == 1:
            return arg
        queue, name = self.state("queue", "deque()"), self.name("s")
        worse = ">=" if psi.least else "<="
        lines = [
            f"queue = {queue}",
            *block(f"while queue and queue[-1][0] {worse} {arg.value}", ["queue.pop()"]),
            f"queue.append(({arg.value}, now))",
            f"if queue[0][1] <= now - {width}: queue.popleft()",
            f"{name} = queue[0][0]",
        ]
        self.write(arg.since, lines)
        return arg._replace(value=name)

    def _since(self, psi: Since, b: int, left: Formula, right: Formula, lo: int) -> Stream:
        first = 0 if b == END else max(0, lo - b)
        goal = self.stream(right, first)
        if b == 0:
            return goal
        guard = self.stream(left, first + 1)
        delay = max(guard.delay, goal.delay)
        guard, goal = self._delayed(guard, delay), self._delayed(goal, delay)
        v, w, name = guard.value, goal.value, self.name("s")
        if b == END:
            state = self.states[psi] = self.state("so_far", "-inf")
            self.write(goal.since, [f"{state} = {w}"], guard.since - 1)
            lines = [f"if {state} > {v}: {state} = {v}", f"if {w} > {state}: {state} = {w}"]
            self.write(guard.since, lines)
            self.write(goal.since, [f"{name} = {state}"])
            return Stream(name, delay, lo + delay)
        queue = self.state("queue", "deque()")
        cut = [
            "first = queue.popleft()",
            f"while queue and queue[0][0] >= {v}: first = queue.popleft()",
            f"queue.appendleft(({v}, first[1]))",
        ]
        self.write(guard.since, [f"queue = {queue}", *block(f"if queue and queue[0][0] >= {v}", cut)])
        lines = [
            f"queue = {queue}",
            f"while queue and queue[-1][0] <= {w}: queue.pop()",
            f"queue.append(({w}, now))",
            f"if queue[0][1] < now - {b}: queue.popleft()",
            f"{name} = queue[0][0]",
        ]
        self.write(goal.since, lines)
        return Stream(name, delay, lo + delay)

    # --- steps to come

    def tail(self, psi: Formula, worst: bool, stop: int, lines: list[str]) -> str:
        """The least (`worst`) or greatest value of psi at a step to come, at most `stop`.

        An operator of the past has one value at all steps to come, or its greatest one at the last: that of H[0,b] then
        is the least since step `stop` - b.
        """
        if psi in self.parts:
            return "-inf" if worst else "inf"
        if isinstance(psi, Not):
            return self.negative(self.tail(psi.arg, not worst, stop, lines), lines)
        if not isinstance(psi, Connective) and any(map(_has_interval, operands_of(psi))):
            raise UnsupportedError
        ends = [self.tail(arg, worst, stop, lines) for arg in operands_of(psi)]
        match psi:
            case Connective():
                return self.folded(ends, psi.least, lines)
            case Window(0, b, _) if psi.past and b == END:
                return self.folded([self.states[psi], *ends], psi.least, lines)
            case Window(0, b, _) if psi.past and ends == ["inf"]:
                return self._since_step(psi, stop - b) if psi.least and stop < END else "inf"
            case Since(0, b, _, _) if b == END:
                return self.folded([ends[1], self.folded([self.states[psi], ends[0]], True, lines)], False, lines)
            case Since(0) if (worst and ends == ["-inf", "-inf"]) or ends[1] == "inf":
                return ends[1]
            case _:
                raise UnsupportedError

    def _since_step(self, psi: Window, first: int) -> str:
        """The least value of the operand from a step on, which is the extreme of the last window."""
        if psi not in self.states:
            self.states[psi] = self.state("so_far", "inf")
            arg = self.stream(psi.arg, max(0, first))
            take = f"if {arg.value} < {self.states[psi]}: {self.states[psi]} = {arg.value}"
            self.write(max(0, first), [take])
        return self.states[psi]

    def negative(self, value: str, lines: list[str]) -> str:
        if value in ("inf", "-inf"):
            return "inf" if value == "-inf" else "-inf"
        lines.append(f"{(name := self.name('s'))} = -{value}")
        return name

    def folded(self, values: Sequence[str], least: bool, lines: list[str]) -> str:
        """The least or the greatest of names and infinities."""
        neutral, absorbing = ("inf", "-inf") if least else ("-inf", "inf")
        names = [value for value in dict.fromkeys(values) if value != neutral]
        if absorbing in names or not names:
            return absorbing if names else neutral
        result, better = names[0], "<" if least else ">"
        for value in names[1:]:
            lines.append(f"{(name := self.name('s'))} = {value} if {value} {better} {result} else {result}")
            result = name
        return result


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
        case Window(a, b, arg) if psi.past:
            known = earliest(arg)
            if psi.least:
                return known if a == 0 else -math.inf
            return known if known == math.inf else known - _steps(b)
        case Window(a, b, arg):
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
    if isinstance(psi, Window | Between):
        return (
            max(0.0, inner - psi.a)
            if psi.past and not isinstance(psi, Since)
            else inner + _steps(0 if psi.past else psi.b)
        )
    return inner


def rises(psi: Formula) -> bool:
    """Whether the greatest value of psi is inf at all steps that are far enough ahead; psi as in `earliest`."""
    match psi:
        case Not(Since(0, b, left, right)):
            ends = [right] if b < END else [left, right]
            return all(rises(negations_inside(Not(end))) for end in ends)
        case Connective() if is_temporal(psi):
            return (all if psi.least else any)(rises(arg) for arg, _ in psi.signed)
        case Window(_, b, arg):
            return rises(arg) and not (psi.past and psi.least and b == END)
        case Between(_, _, _, right):
            return rises(right)
        case _:
            return True


def _has_interval(psi: Formula) -> bool:
    return any(isinstance(node, Window | Between) and node.b < END for node in walk(psi))


def _steps(end: int) -> float:
    return math.inf if end == END else end
