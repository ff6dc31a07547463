"""Random formulas, times within the rows of a plan, and traces that satisfy a schedule, to check what it implies."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stlbench import stl
from stlbench.schedules.plan import Plan, conjunction, plans
from stlbench.stl import END, Formula, Number, Predicate, Signal, Term

NAMES = ("p", "q", "r", "s")
PREDICATES = tuple(Predicate(">=", Signal(name), Number(0.0)) for name in NAMES)

Traces = NDArray[np.float64]


def random_formula(
    generator: np.random.Generator, depth: int = 4, longest: int = 4, predicates: Sequence[Formula] = PREDICATES
) -> Formula:
    """A formula of all operators, nested up to `depth`, with intervals up to `longest`."""

    def inner(less: int = 1) -> Formula:
        return random_formula(generator, depth - less, longest, predicates)

    def two() -> tuple[Formula, Formula]:
        return (inner(), inner(1 + int(generator.integers(3))))[:: int(generator.choice([1, -1]))]  # type: ignore[return-value]

    if depth <= 0 or generator.random() < 0.1:
        plain = predicates[int(generator.integers(len(predicates)))]
        return stl.TrueFormula() if generator.random() < 0.02 else plain
    first, last = sorted(int(each) for each in generator.integers(0, longest + 1, 2))
    past = (0, END) if generator.random() < 0.3 else (first, last)
    match int(generator.integers(20)):
        case 0 | 1:
            return stl.Not(inner())
        case 2 | 3:
            return stl.And(two())
        case 4 | 5:
            return stl.Or(two())
        case 6:
            return stl.Implies(*two())
        case 7:
            return stl.iff(*two())
        case 8:
            return stl.xor(*two())
        case 9 | 10:
            return stl.Always(first, last, inner())
        case 11 | 12:
            return stl.Eventually(first, last, inner())
        case 13 | 14:
            return stl.Until(first, last, *two())
        case 15:
            return stl.Release(first, last, *two())
        case 16:
            return stl.weak_until(first, last, *two())
        case 17:
            return stl.Historically(*past, inner())
        case 18:
            return stl.Once(*past, inner())
        case _:
            return stl.Since(*past, *two())


def drawn_values(plan: Plan, generator: np.random.Generator, last: int) -> tuple[int, ...] | None:
    """Values of the variables that keep the rows, many of them as early or as late as can be; None where none do.

    The rows are differences: the longest ways between the variables tell how far apart these have to be.
    """
    count = plan.variables
    apart = np.full((count + 1, count + 1), -np.inf)  # [i, j]: j is at least so many steps after i; the last is 0
    np.fill_diagonal(apart, 0.0)
    apart[count, :count] = 0.0
    apart[:count, count] = -last - 1.0
    for earlier, later in plan.rows:
        i, j = (count if at.variable is None else at.variable for at in (earlier, later))
        apart[i, j] = max(apart[i, j], earlier.offset - later.offset)
    for through in range(count + 1):
        np.maximum(apart, apart[:, through, None] + apart[through], out=apart)
    if (np.diagonal(apart) > 0).any():
        return None
    for each in generator.permutation(count):
        low, high = int(apart[count, each]), int(-apart[each, count])
        chosen = (low, high, int(generator.integers(low, high + 1)))[int(generator.integers(3))]
        apart[count, each], apart[each, count] = chosen, -chosen
        for through in (each, count):
            np.maximum(apart, apart[:, through, None] + apart[through], out=apart)
    return tuple(int(value) for value in apart[count, :count])


def keeps(plan: Plan, values: Sequence[int]) -> bool:
    """Whether values keep all rows of a plan and none is before step 0."""
    return min(values, default=0) >= 0 and all(earlier.of(values) <= later.of(values) for earlier, later in plan.rows)


@lru_cache
def _samples(signals: int) -> Traces:
    """All samples of so many signals that are 1 or -1."""
    return np.array(list(itertools.product((1.0, -1.0), repeat=signals)))


@lru_cache(maxsize=100_000)
def _truths(psi: Formula, names: tuple[str, ...]) -> NDArray[np.bool_]:
    """At which of the samples a condition holds."""
    samples = _samples(len(names))
    return np.broadcast_to(stl.holds(psi, names)(samples), len(samples))


def satisfying_trace(
    terms: Sequence[Term], steps: int, generator: np.random.Generator, names: tuple[str, ...] = NAMES
) -> Traces | None:
    """A random trace (steps, k) of 1 and -1 that satisfies all terms; None where none was found.

    Events take steps at random, more often the first or the last of their windows. Samples that no term asks for are
    as in a random trace, in which each signal has its own share of truths.
    """
    samples = _samples(len(names))
    allowed = np.ones((steps, len(samples)), dtype=bool)
    for term in sorted(terms, key=lambda term: term.kind != "G"):
        truths = _truths(term.psi, names)
        if term.kind == "G":
            allowed[term.a : term.b + 1] &= truths
            continue
        latest, length = (term.b, 1) if term.kind == "F" else (term.c1, term.b + 1)
        begins = generator.permutation(np.arange(term.a, latest + 1)).tolist()
        if generator.random() < 0.5:
            begins = [*((term.a, latest) if generator.random() < 0.5 else (latest, term.a)), *begins]
        for begin in begins:
            if (allowed[begin : begin + length] & truths).any(axis=1).all():
                allowed[begin : begin + length] &= truths
                break
        else:
            return None
    if not allowed.any(axis=1).all():
        return None
    shares = generator.choice([0.02, 0.1, 0.5, 0.9, 0.98], len(names))
    likely = np.where(samples > 0, shares, 1 - shares).prod(axis=1)
    # a draw by likelihood, or nearly the likeliest sample
    is_drawn, noise = generator.random() < 0.5, generator.random(allowed.shape)
    noise = -1 / np.log(noise) if is_drawn else noise
    chosen: Traces = samples[np.where(allowed, likely * noise, -1.0).argmax(axis=1)]
    return chosen


def all_traces(signals: int, steps: int) -> Traces:
    """Every trace (n, steps, k) of so many signals that are 1 or -1."""
    return _samples(signals * steps).reshape(-1, steps, signals)


class Checked(NamedTuple):
    """What was checked of one formula."""

    plans: int
    schedules: int
    """Plans with some of their times."""
    traces: int
    counterexample: str = ""
    """A formula, a schedule, and a trace that satisfies the schedule alone; nothing where there is none."""


MOST_CHECKED = 24
"""Plans of one formula that are looked at."""


def checked(seed: int) -> Checked:
    """A random formula, times of its plans, and random traces that satisfy the terms: do these satisfy the formula?"""
    generator = np.random.default_rng(seed)
    formula = random_formula(generator, depth=int(generator.integers(1, 5)))
    horizon = stl.horizon(formula)
    last = max(0, horizon + int(generator.integers(-3, 6)))
    steps = max(horizon, last) + 1 + int(generator.integers(3))
    found = plans(formula, last)
    looked_at = generator.permutation(len(found))[:MOST_CHECKED]
    drawn = list[tuple[Term, ...]]()
    for each in looked_at:
        for _ in range(1 if len(looked_at) > 8 else 2):
            if (values := drawn_values(found[each], generator, last)) is not None:
                assert keeps(found[each], values)
                drawn.append(found[each].terms(values))
    pairs = [
        (terms, trace)
        for terms in drawn
        for _ in range(3)
        if (trace := satisfying_trace(terms, steps, generator)) is not None
    ]
    if pairs:
        verdicts = stl.satisfied(formula, np.array([trace for _, trace in pairs]), NAMES)
        if not verdicts.all():
            terms, trace = pairs[int(verdicts.argmin())]
            own = bool(stl.satisfied(conjunction(terms), trace, NAMES)) if terms else True
            text = f"seed {seed}: {formula}; last {last}; {shown(terms)} ({own}); {(trace > 0).astype(int).T.tolist()}"
            return Checked(len(found), len(drawn), len(pairs), text)
    return Checked(len(found), len(drawn), len(pairs))


def all_values(plan: Plan, last: int) -> list[tuple[int, ...]]:
    """All values of the variables that keep the rows, up to the step after the last one."""
    found = list[tuple[int, ...]]([()])
    for variable in range(plan.variables):
        known = {None, *range(variable + 1)}
        rows = [row for row in plan.rows if variable in (of := {at.variable for at in row}) and of <= known]
        longer = [(*values, value) for values in found for value in range(last + 2)]
        found = [values for values in longer if all(earlier.of(values) <= later.of(values) for earlier, later in rows)]
    return [values for values in found if keeps(plan, values)]


def parsed(text: str) -> Formula:
    """A formula in which p stands for p >= 0, and so do the other signals."""
    return stl.parse(re.sub(r"\b([pqrs])\b", r"(\1 >= 0)", text))


def shown(terms: Sequence[Term]) -> str:
    """Terms as text, with letters for their predicates."""
    return " & ".join(str(term.formula) for term in terms).replace(" >= 0", "")
