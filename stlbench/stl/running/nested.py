"""Nested and past formulas for one trace: as streams, or evaluated anew at each step."""

from collections.abc import Callable
from itertools import count

import numpy as np

from stlbench.stl.errors import UndefinedError
from stlbench.stl.language.expressions import Number, Signal
from stlbench.stl.language.structure import check_names, is_temporal, operands_of, signals
from stlbench.stl.language.syntax import END, Between, Formula, Predicate, Prefix, Since
from stlbench.stl.predicates import Sample
from stlbench.stl.predicates.writer import block
from stlbench.stl.running.ahead import Ahead, earliest, latest, rises, varies
from stlbench.stl.running.pulling import as_goal, as_until, later, terms
from stlbench.stl.running.scalar import Operator, Piece, Until, value_of
from stlbench.stl.running.streams import Stream, Streams
from stlbench.stl.running.tree import Kit, Pointwise, UnsupportedError
from stlbench.stl.running.unfolding import Decided, Known, Recent, Unfolding


class Streamed(Operator):
    """F[a,b] psi, or its opposite, as the best of some streams."""

    def __init__(self, number: int, formula: Formula, names: tuple[str, ...], negated: bool) -> None:
        """Raises UnsupportedError where psi is no stream."""
        until, spans = as_until(formula), dict[Formula, tuple[int, int]]()
        psi = as_goal(until)
        _reads(psi.psi, psi.start, psi.stop, spans)
        if not all(varies(part, names) for part in spans):
            raise UnsupportedError
        marks = {part: Predicate(">=", Signal(f"part{i}"), Number(0.0)) for i, part in enumerate(spans)}
        goals = terms(psi._replace(psi=_marked(psi.psi, marks)))
        risen = [goal for goal in goals if goal.stop == END and rises(goal.psi)]
        known = [goal for goal in goals if goal not in risen or earliest(goal.psi) < np.inf]  # others are never known
        if not known:
            spans = dict.fromkeys(spans, (0, END))
        self.spans = spans
        firsts, lasts = zip(*spans.values(), strict=True)
        super().__init__(number, min(firsts), max(lasts), until.opposite is not negated)
        self.values = [Pointwise(value_of(part, names, False), (-np.inf, np.inf)) for part in spans]
        parts = enumerate(zip(marks.values(), spans.values(), strict=True))
        self.streams = Streams(number, {mark: Stream(f"v{number}_{i}", 0, first) for i, (mark, (first, _)) in parts})
        self.ahead = Ahead(self.streams)
        self.rises, self.best = bool(risen), f"m.best{number}"
        self.terms = [
            (goal, self.ahead.held(goal, self.best) or self.streams.stream(goal.psi, goal.start)) for goal in known
        ]
        if any(stream.delay and earliest(goal.psi) < latest(goal.psi) for goal, stream in self.terms):
            raise UnsupportedError
        self._bounds(-1, [])
        for now in sorted(self.cuts()):
            self._bounds(now, [])  # writes all streams, or raises
        self.start = min([self.start, *(each.first for each in self.streams.steps)])
        self.stop = max([self.stop, *(later(term.stop, stream.delay) for term, stream in self.terms)])

    def begin(self) -> list[str]:
        self.streams.begin = list(dict.fromkeys(self.streams.begin))
        lines = list[str]()
        lower, upper = self._bounds(-1, lines)
        return [*self.streams.begin, f"{self.best} = -inf", *lines, *self.publish(lower, upper)]

    def cuts(self) -> set[int]:
        ends = {step for each in self.streams.steps for step in (each.first, each.last + 1)}
        starts = {term.start + stream.delay for term, stream in self.terms}
        delays = [(term.stop, more) for term, stream in self.terms for more in {0, stream.delay}]
        stops = {later(stop, more + after) for stop, more in delays for after in (0, 1)}
        read = {step for first, last in self.spans.values() for step in (first, later(last, 1))}
        return {step for step in ends | starts | stops | read | self.ahead.turns if 0 <= step < END}

    def piece(self, first: int, last: int) -> Piece:
        columns, read, sign = set[int](), list[str](), list[str]()
        for i, (psi, (since, until)) in enumerate(zip(self.values, self.spans.values(), strict=True)):
            name = f"v{self.number}_{i}"
            if since <= first <= until:
                of_part, read_part, sign_part = self.reading(name, psi)
                columns |= of_part
                read += read_part
                sign += sign_part
            elif first > until:  # no goal counts it any more
                read.append(f"{name} = 0.0")
        take = [line for each in self.streams.steps if each.first <= first <= each.last for line in each.lines]
        quiet = self.ahead.quiet if self._is_idle(first) else ""
        if quiet and len(self.values) > 1:  # it looks at one part, and each may refuse the sample
            read, sign = [*read, *sign], []
        return Piece(first, last, columns, read, quiet, sign, [*take, *self._answer(first)])

    def _is_idle(self, now: int) -> bool:
        """Whether nothing changes while nothing begins: there is one queue, of a part that is read."""
        read = [f"v{self.number}_{i}" for i, (first, last) in enumerate(self.spans.values()) if first <= now <= last]
        with self.streams.temporaries():
            rises = self._bounds(now, []) == (self.best, "inf")
        alone = len(self.terms) == len(self.streams.begin) == 1 and self.ahead.quiet.partition(" ")[0] in read
        return alone and rises

    def _answer(self, now: int) -> list[str]:
        """The best of the streams that have a value, and the bounds."""
        values = [stream.value for (a, b, _), stream in self.terms if a <= now - stream.delay <= b]
        lines = list[str]()
        with self.streams.temporaries():
            return self._answer_of(values, lines, *self._bounds(now, lines))

    def _answer_of(self, values: list[str], lines: list[str], lower: str, upper: str) -> list[str]:
        better = [block(f"if {value} > {self.best}", [f"{self.best} = {value}"]) for value in values]
        if lower == self.best and upper == "inf":
            return [line for each in better for line in [*each, *(f" {line}" for line in self.publish(lower, upper))]]
        if self.flipped:
            lower, upper = self.ahead.negative(upper, lines), self.ahead.negative(lower, lines)
        new = [f"{self.lower} = {lower}", f"{self.upper} = {upper}", "changed = True"]
        changes = block(f"if {self.lower} != {lower} or {self.upper} != {upper}", new)
        return [line for each in better for line in each] + lines + changes

    def _bounds(self, now: int, lines: list[str]) -> tuple[str, str]:
        """After the lines, when sample `now` has been taken."""
        least, greatest = [self.best], [self.best, *(["inf"] if self.rises else [])]
        for term, stream in self.terms:
            if not (stream.delay or earliest(term.psi) >= 0):
                least.append(self.ahead.least(term, now, lines))
            if not self.rises:
                greatest.append(self.ahead.greatest(term, stream.delay, now, lines))
        return self.ahead.folded(least, False, lines), self.ahead.folded(greatest, False, lines)


class Replayed(Operator):
    """Any other formula: keeps the samples that what is not decided may still read, and evaluates it at each step."""

    def __init__(self, number: int, formula: Formula, names: tuple[str, ...], negated: bool) -> None:
        self.until = Unfolding(formula, names)
        super().__init__(number, 0, self.until.last, self.until.flipped is not negated)
        index = check_names(formula, names)
        self.columns = {index[name] for name in signals(formula)}
        self.namespace |= {f"begin{number}": self._begin, f"read{number}": self._read, f"take{number}": self._take}

    def begin(self) -> list[str]:
        return [f"m.samples{self.number}, m.state{self.number} = begin{self.number}()", *self.publish("-inf", "inf")]

    def piece(self, first: int, last: int) -> Piece:
        n, v = self.number, self.v
        read = f"{v} = read{n}(m.samples{n}, m.state{n}, sample, now)"
        state = [f"m.state{n} = {v}.state", f"take{n}(m.samples{n}, now)"]
        bounds = self.publish(f"{v}.lower.item()", f"{v}.upper.item()")
        return Piece(first, last, self.columns, [read], "", [], [*state, *bounds])

    def _begin(self) -> tuple[Recent, Decided]:
        return Recent(1, len(self.until.names)), self.until.begin(1)

    def _read(self, samples: Recent, state: Decided, sample: Sample, now: int) -> Known:
        newest = np.array([[value if i in self.columns else 0.0 for i, value in enumerate(sample)]])
        try:
            return self.until.read(samples.with_newest(newest, min(now + 1, self.until.window)), now, state)
        except UndefinedError as error:
            raise UndefinedError(error.what, error.sample) from None

    def _take(self, samples: Recent, now: int) -> None:
        samples.take(min(now + 1, self.until.window))


def one() -> Kit[Operator]:
    """The operators for one trace, numbered from 0."""
    numbers = count()

    def numbered(operator: Callable[..., Operator]) -> Callable[..., Operator]:
        return lambda *arguments: operator(next(numbers), *arguments)

    return Kit(min, max, value_of, numbered(Until), None, numbered(Streamed), numbered(Replayed))


def _reads(psi: Formula, lo: int, hi: int, spans: dict[Formula, tuple[int, int]]) -> None:
    """The first and last step at which each part without temporal operators is read, for psi at the steps lo..hi."""
    match psi:
        case _ if not is_temporal(psi):
            first, last = spans.get(psi, (lo, hi))
            spans[psi] = min(lo, first), max(hi, last)
        case Prefix(a, b, arg):
            if psi.past:
                _reads(arg, 0 if b == END else max(0, lo - b), later(hi, -a), spans)
            else:
                _reads(arg, lo + a, later(hi, b), spans)
        case Between(0, 0, _, right):
            _reads(right, lo, hi, spans)
        case Since(a, b, left, right):
            first = 0 if b == END else max(0, lo - b)
            _reads(right, first, later(hi, -a), spans)
            _reads(left, first + 1, hi, spans)
        case Between(a, b, left, right):
            _reads(right, lo + a, later(hi, b), spans)
            _reads(left, lo, later(hi, b - (b < END)), spans)
        case _:
            for arg in operands_of(psi):
                _reads(arg, lo, hi, spans)


def _marked(psi: Formula, marks: dict[Formula, Predicate]) -> Formula:
    """psi with a mark for each part without temporal operators."""
    if not is_temporal(psi):
        return marks.get(psi, psi)  # one that is never read stays
    return psi.with_operands([_marked(arg, marks) for arg in operands_of(psi)])
