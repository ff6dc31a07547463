"""The derived formula: what reward methods are given on the track `auto` in place of the task's own formula.

Its predicates are those of the formula that it is derived from, brought to one scale by their roles. Each keeps its
sign, so the same traces satisfy both. The track `auto` derives it from the task's formula in its
`forms.normal_form`, which may ask for less: G[c,d] (p | q) in place of G[c,d] p | G[c,d] q. So every trace that
satisfies the task's formula satisfies the derived one, and others may too. The referee scores the task's own formula.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from math import log

from stlbench import stl
from stlbench.contract import Array
from stlbench.stl import And, Formula, Predicate
from stlbench.stl.language.syntax import Connective
from stlbench.task.forms import Box, Scale, Window, scale, violated, windows, with_parts

FARTHEST, BESIDE = 0.4, 1.0
"""The cost of a goal at its worst: alone, and beside invariants, which cost at least as much when they are violated."""
BEST = 0.5
"""The pay of a goal at its best."""
MOST_HELD = 5
"""Steps of a decision that a violation in one of them outweighs. Without this factor `raw` learned one of the four
tasks with obstacles and one goal; with it, all four (seeds from 100)."""
STEEP = 50.0
"""The cost of an invariant rises to 1 within its depth over this number: nearly a jump."""
CLEARANCE = 0.3
"""The pay of an invariant at its best."""
KEPT = 4.0
"""A predicate that the start keeps costs no more beyond so many near sizes."""
WIDE = 4.0
"""Ranges are too wide to tell a goal's scale if the near size is so many times what the starts violate. An ant with
speeds up to 10 m/s never walked at 0.5: to stand still cost a twelfth of it, and a fall costs two."""


def derived(formula: Formula, box: Box, units: Mapping[str, str], initial: Array, hold: int = 1) -> Formula:
    """The formula with its predicates on one scale.

    The margin m of a predicate with the near size w (`forms.Scale`) becomes

    - of a goal: -c log(1 - m / w) / K where m < 0, with K the largest such logarithm in its window, so that it is from
      -c to 0, and c = .4, or 1 beside invariants; .5 m / best where m >= 0, with `best` the largest margin of all that
      has to hold with it;
    - of a kept predicate, which holds at all initial states beside others that do not: the same, but -m / w counts at
      most 4. So a robot that starts at rest may move until it is there;
    - of a goal that the starts violate by less than a quarter of w, as a speed with a wide range: the same on the scale
      of the starts. What they violate is then the largest margin and violation, and -m / w counts at most 4;
    - of an invariant, with d half of the least near size among the invariants of its unit: h max(-1, 50 m / d) +
      max(-1, m / d) where m < 0; .3 min(m / d, 1) where m >= 0. So even a shallow violation costs as much as the goal
      that is farthest away: a minimum over both does not hide it. The factor h is the number of steps for which an
      action is held, at most 5. The reward of a decision is the mean of its steps, so no corner is worth cutting. The
      factor is 1 for a robot that can fall: with more it would not dare to move.

    A predicate whose margin is 0 at best, as `collisions <= 0`, pays .3 while it holds. A violation by more than a
    billionth of its range costs 1. If a formula asks for invariants alone, they count as goals.

    Args:
        formula: the task's formula; intervals in steps.
        box: the ranges of the signals.
        units: signal -> its unit; a signal without a unit counts as a unit of its own.
        initial: samples (n, k) at the start of episodes.
        hold: steps for which an action is held.
    """
    parts = windows(formula)
    invariants = [part for part in parts if part.invariant] if any(not part.invariant for part in parts) else []
    cost = BESIDE if can_fall(formula, box) else BESIDE * min(hold, MOST_HELD)
    depths = dict[tuple[str, ...], float]()
    for predicate, _ in (each for part in invariants for each in _signed(part.psi)):
        unit, depth = _unit(predicate, units), scale(predicate, box).near / 2
        depths[unit] = min(depth, depths.get(unit, depth))

    def part(window: Window) -> Formula:
        if window in invariants:
            return _rescaled(
                window.psi, lambda each: _invariant(_Margin.of(each, box), depths[_unit(each[0], units)], cost)
            )
        return _goal(window.psi, box, initial, BESIDE if invariants else FARTHEST)

    return with_parts(formula, part)


def can_fall(formula: Formula, box: Box) -> bool:
    """Whether an invariant of at least half of the formula's time is violated wherever a signal leaves its range.

    So it is with a limit of a tilt, but not with an obstacle in a room.
    """
    parts = windows(formula)
    half = max(part.end for part in parts) / 2
    long = [part.psi for part in parts if part.invariant and part.end >= half]
    conjuncts = [each for psi in long for each in (psi.args if isinstance(psi, And) else (psi,))]
    return any(_limits(each, name, box) for each in conjuncts for name in stl.signals(each))


def _limits(psi: Formula, name: str, box: Box) -> bool:
    """Whether a formula without temporal operators is violated wherever a signal is at an end of its range."""
    return any(violated(psi, {**box, name: (end, end)}) for end in box[name])


_Signed = tuple[Predicate, bool]
"""A predicate, and whether it stands inside of a negation."""


@dataclass(frozen=True)
class _Margin:
    """A margin that has to be positive: its text and its sizes."""

    text: str
    size: Scale
    tight: bool
    """Whether it is met at its border alone."""
    capped: bool = False
    """Whether it costs no more beyond `KEPT` near sizes."""

    def beside(self, violation: float) -> _Margin:
        """Itself, or on the scale of the starts, which violate it so much, if the ranges are too wide to tell one."""
        if self.tight or not 0 < WIDE * violation < self.near:
            return self
        return replace(self, size=Scale(min(self.size.best, violation), violation), capped=True)

    @classmethod
    def of(cls, signed: _Signed, box: Box) -> _Margin:
        """The margin of a predicate, or of its negation."""
        predicate, negated = signed
        size = scale(predicate, box)
        greater, less = predicate.left, predicate.right
        if predicate.op.startswith("<") != negated:
            greater, less = less, greater
        # A strict comparison is never met at its border, so `tight` is for closed ones; a negation swaps the two.
        size, closed = size.negated if negated else size, ("=" in predicate.op) != negated
        return cls(f"({greater} - ({less}))", size, size.tight and closed)

    @property
    def near(self) -> float:
        """The near size, at most half of the worst violation: a distance is then resolved on its whole way."""
        return min(self.size.near, self.size.worst / 2)

    @property
    def octaves(self) -> float:
        """The logarithm of the worst violation."""
        return log(1 + self.size.worst / self.near)


def _goal(psi: Formula, box: Box, initial: Array, farthest: float) -> Formula:
    signed = list(_signed(psi))
    kept = {each for each in signed if _holds(each, tuple(box), initial)}
    if len(kept) == len(signed) or not isinstance(psi, And):  # a cap is for a part beside others that are not yet met
        kept = set()
    margins = {each: _Margin.of(each, box).beside(_violation(each, tuple(box), initial)) for each in signed}
    octaves = max((margin.octaves for margin in margins.values()), default=1.0)
    best = scale(psi, box).best

    def shape(each: _Signed) -> str:
        margin = margins[each]
        if margin.tight:
            return _all_or_nothing(margin)
        far = f"max(0, -{margin.text}) / {margin.near:.9g}"
        if each in kept or margin.capped:
            far = f"min({KEPT:g}, {far})"
        reached = f"{BEST:g} * min(1, max(0, {margin.text}) / {min(margin.size.best, best):.9g})"
        return f"{reached} - {farthest / octaves:.9g} * log(1 + {far})"

    return _rescaled(psi, shape)


def _invariant(margin: _Margin, depth: float, cost: float) -> str:
    if margin.tight:
        return _all_or_nothing(margin)
    deep = f"{margin.text} / {depth:.9g}"
    border = f"max(-{cost:g}, min(0, {STEEP * cost:g} * {deep}))"
    return f"{CLEARANCE:g} * min(1, max(0, {deep})) + {border} + max(-1, min(0, {deep}))"


def _all_or_nothing(margin: _Margin) -> str:
    """The form of a margin that is 0 at best: it pays its best there, and costs 1 from a billionth of the range on."""
    return f"max(-1, min({CLEARANCE:g}, {CLEARANCE:g} + {margin.text} / {1e-9 * margin.size.worst:.9g}))"


def _rescaled(psi: Formula, shape: Callable[[_Signed], str], negated: bool = False) -> Formula:
    """A formula without temporal operators with new margins; `shape` gives what has to be positive, as text."""
    match psi:
        case Predicate(op):
            compared = f"{'<' if negated else '>'}{op[1:]}"  # the border counts as before
            return stl.parse(f"{shape((psi, negated))} {compared} 0")
        case Connective():
            return psi.with_operands([_rescaled(arg, shape, own is not negated) for arg, own in psi.signed])
        case _:
            return psi


def _signed(psi: Formula, negated: bool = False) -> Iterator[_Signed]:
    """The predicates, each with whether it stands inside of a negation."""
    match psi:
        case Predicate():
            yield psi, negated
        case Connective():
            for arg, own in psi.signed:
                yield from _signed(arg, own is not negated)


def _holds(signed: _Signed, names: tuple[str, ...], initial: Array) -> bool:
    """Whether it holds at all initial samples."""
    predicate, negated = signed
    return bool((stl.holds(predicate, names)(initial) != negated).all())


def _violation(signed: _Signed, names: tuple[str, ...], initial: Array) -> float:
    """The most by which an initial sample violates it; 0 if it holds at all of them."""
    predicate, negated = signed
    margins = stl.margin(predicate, names)(initial)
    return max(0.0, float((margins if negated else -margins).max(initial=0.0)))


def _unit(predicate: Predicate, units: Mapping[str, str]) -> tuple[str, ...]:
    return tuple(sorted({units.get(name) or name for name in stl.signals(predicate)}))
