"""How far a formula is: a stage for each F term and F G term, all of them together a number.

To maximise the least of several margins, a planner has to know which terms are still to come. For F[a,b] psi that is
whether the sample that counts has been: once it has, the term asks for nothing more. For F[a,c1] G[c2,b] psi it is how
many decisions of the window have been. Without a stage, a policy that is greedy on values may put an F off for ever.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stlbench.stl import Term

Truth = NDArray[np.bool_]


class Part(NamedTuple):
    """What one term contributes at a decision: the least or the greatest margin of some of its samples."""

    term: int
    active: bytes
    """Which of the H samples, as bytes of Booleans."""
    least: bool


class Move(NamedTuple):
    """One way to go on from a stage, with what must hold meanwhile."""

    then: int
    parts: tuple[Part, ...]


@dataclass(frozen=True)
class _Choice:
    then: int
    part: Part | None = None


@dataclass(frozen=True)
class Stages:
    """The stages of a formula's terms. Each term's is 0 at first; its last one means that it is over."""

    terms: tuple[Term, ...]
    hold: int

    @property
    def sizes(self) -> tuple[int, ...]:
        """Stages of each term: 1 of G, 2 of F, and of F G one more for each decision that its window lasts."""
        return tuple({"G": 1, "F": 2, "FG": self._lasts(term) + 1}[term.kind] for term in self.terms)

    @property
    def count(self) -> int:
        """Stages of all terms together."""
        return int(np.prod(self.sizes))

    @property
    def over(self) -> int:
        """The stage in which no term has anything still to come, but the G terms."""
        return self.count - 1

    def without_window(self) -> Term | None:
        """An F G term that can never begin, since no decision's first sample is among those at which it may."""
        for term in self.terms:
            first = max(0, -(-(term.start - 1) // self.hold)) * self.hold + 1
            if term.kind == "FG" and first > term.c1 + term.c2:
                return term
        return None

    def moves(self, stage: int, decision: int) -> Iterator[Move]:
        """All ways to go on from a stage over a decision, those that come nearest to the end first."""
        each = np.unravel_index(stage, self.sizes)
        options = [
            tuple(self._choices(i, term, int(now), decision))
            for i, (term, now) in enumerate(zip(self.terms, each, strict=True))
        ]
        for chosen in product(*options):
            then = int(np.ravel_multi_index([choice.then for choice in chosen], self.sizes))
            yield Move(then, tuple(choice.part for choice in chosen if choice.part is not None))

    def _choices(self, i: int, term: Term, now: int, decision: int) -> Iterator[_Choice]:
        t = decision * self.hold + 1 + np.arange(self.hold)
        inside = (term.start <= t) & (t <= term.end)
        if term.kind == "G":
            yield _Choice(0, Part(i, inside.tobytes(), True) if inside.any() else None)
        elif term.kind == "F":
            if now == 0 and inside.any():
                yield _Choice(1, Part(i, inside.tobytes(), False))
            if now == 1 or t[-1] < term.end:
                yield _Choice(now)
        else:
            yield from self._window(i, term, now, int(t[0]))

    def _window(self, i: int, term: Term, now: int, first: int) -> Iterator[_Choice]:
        """A window begins with a decision: its first sample is that decision's first."""
        last, begins = self._lasts(term), term.start <= first <= term.c1 + term.c2
        if now == last:
            yield _Choice(last)
        elif now > 0 or begins:
            left = term.b - term.c2 + 1 - now * self.hold
            yield _Choice(now + 1, Part(i, (np.arange(self.hold) < left).tobytes(), True))
        if now == 0 and first + self.hold <= term.c1 + term.c2:
            yield _Choice(0)

    def _lasts(self, term: Term) -> int:
        """Decisions that the window of an F G term lasts."""
        return -(-(term.b - term.c2 + 1) // self.hold)
