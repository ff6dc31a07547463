"""Nested and past formulas for one trace, as source: each operator turns the stream of its operand into its own.

A stream has the value of a formula at step t when sample t + delay has come, at constant amortised cost: windows are
monotone queues, since and the operators of the past without an interval are a number. `pulling` first makes operands
look back. Then F psi is the best of a stream so far, if nothing of psi is known before all of it is (`earliest`).
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

from stlbench.stl.language.syntax import END, And, Connective, Formula, Historically, Once, Prefix, Since
from stlbench.stl.predicates.writer import block
from stlbench.stl.running.pulling import During, all_of, conjuncts, later
from stlbench.stl.running.tree import UnsupportedError


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

    @contextmanager
    def temporaries(self) -> Iterator[None]:
        """Names that are given away here may be given again: statements of different samples are alike then."""
        names = self._names
        yield
        self._names = names

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
            case During():
                return self._during(psi, None, lo)
            case And(args) if any(isinstance(arg, During) for arg in args):
                during = next(arg for arg in args if isinstance(arg, During))
                rest = all_of([arg for arg in args if arg is not during])
                return self._during(during, self.stream(rest, max(lo, during.first)), lo)
            case Connective():
                return self._joined(psi, lo)
            case Prefix() if psi.past:
                return self._past(psi, lo)
            case Prefix(a, b, arg) if b < END:
                inner = self.stream(arg, lo + a)
                return self._extreme(psi, inner, b - a + 1)._replace(delay=inner.delay + b, since=lo + inner.delay + b)
            case Since(0, 0, _, right):
                return self.stream(right, lo)
            case Since(0, b, left, right):
                return self._since(psi, b, left, right, lo)
            case Since(a, b, left, right):
                begun = Once(a, a, Since(0, b - a, left, right))
                return self.stream(And((Historically(0, a - 1, left), begun, During(_onset(right) + a, END))), lo)
            case _:
                raise UnsupportedError

    def _during(self, psi: During, stream: Stream | None, lo: int) -> Stream:
        """inf, or a stream, at the steps of `psi`; -inf at others."""
        value, delay = ("inf", 0) if stream is None else (stream.value, stream.delay)
        first, name = max(lo, psi.first), self.name("s")
        for begin, end, text in ((lo, first - 1, "-inf"), (first, psi.last, value), (psi.last + 1, END, "-inf")):
            if begin <= end:
                self.write(begin + delay, [f"{name} = {text}"], later(end, delay))
        return Stream(name, delay, lo + delay)

    def _joined(self, psi: Connective, lo: int) -> Stream:
        streams = [self.stream(arg, lo) for arg, _ in psi.signed]
        delay = max(stream.delay for stream in streams)
        streams = [self._delayed(stream, delay) for stream in streams]
        since = max(stream.since for stream in streams)
        values = [
            f"-{stream.value}" if negated else stream.value
            for stream, (_, negated) in zip(streams, psi.signed, strict=True)
        ]
        lines = list[str]()
        name = self.pick(values, psi.least, lines)
        self.write(since, lines)
        return Stream(name, delay, since)

    def pick(self, values: Sequence[str], least: bool, lines: list[str]) -> str:
        """A name, after the lines, for the least or the greatest of some names, which may be negated."""
        result = ""
        for value in values:
            if value.startswith("-"):
                lines.append(f"{(negative := self.name('s'))} = {value}")
                value = negative
            if result:
                better = "<" if least else ">"
                lines.append(f"{(best := self.name('s'))} = {value} if {value} {better} {result} else {result}")
                value = best
            result = value
        return result

    def _delayed(self, stream: Stream, delay: int) -> Stream:
        if (steps := delay - stream.delay) == 0:
            return stream
        line, name = self.state("line", "deque()"), self.name("s")
        push = f"{line}.append({stream.value})"
        self.write(stream.since, [push], stream.since + steps - 1)
        self.write(stream.since + steps, [push, f"{name} = {line}.popleft()"])
        return Stream(name, delay, stream.since + steps)

    def _past(self, psi: Prefix, lo: int) -> Stream:
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
        if lo + delay < arg.since:  # nothing of the interval is in the trace
            self.write(lo + delay, [f"{result.value} = {'inf' if psi.least else '-inf'}"], arg.since - 1)
        return result

    def _extreme(self, psi: Prefix, arg: Stream, width: int) -> Stream:
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
        first = max(_onset(right), 0 if b == END else lo - b)
        goal = self.stream(right, first)
        guard = self.stream(left, first + 1)
        delay = max(guard.delay, goal.delay)
        guard, goal = self._delayed(guard, delay), self._delayed(goal, delay)
        v, w, name = guard.value, goal.value, self.name("s")
        if lo + delay < goal.since:
            self.write(lo + delay, [f"{name} = -inf"], goal.since - 1)
        if b == END:
            state = self.states[psi] = self.state("so_far", "-inf")
            self.write(goal.since, [f"{state} = {w}"], guard.since - 1)
            lines = [f"if {state} > {v}: {state} = {v}", f"if {w} > {state}: {state} = {w}"]
            self.write(max(guard.since, goal.since), lines)
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


def _onset(psi: Formula) -> int:
    """A step before which psi is -inf."""
    return max((arg.first for arg in conjuncts(psi) if isinstance(arg, During)), default=0)
