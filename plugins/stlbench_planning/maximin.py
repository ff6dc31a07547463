"""Backward induction on the formula's robustness: the best that is possible from every state of a grid.

A stage counts how far each F term and F G term is; together they are one number. For F[a,b] psi it is whether the
sample that counts has been, for F[a,c1] G[c2,b] psi how many decisions of the window have been. Without it, a policy
that is greedy on values may put an F off for ever.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stlbench import stl
from stlbench.contract import Array, Integers, Model, StatePolicy, Unsuitable
from stlbench.stl import Term
from stlbench_planning.grid import ActionSet, Floats, Grid, refuse_beyond, simulated, sweep
from stlbench_planning.loops import extremes, reach_best

Truth = NDArray[np.bool_]


class Margin(NamedTuple):
    """The contribution of one term at a decision: the least or the greatest margin of some of its samples."""

    term: int
    active: bytes  # which of the H samples, as bytes of Booleans: margins are keys of a cache
    least: bool

    def extreme(self, margins: Array) -> Array:
        """For samples (N, H): (N,)."""
        chosen = margins[:, np.frombuffer(self.active, np.bool_)]
        extreme: Array = chosen.min(axis=1) if self.least else chosen.max(axis=1)
        return extreme


class Move(NamedTuple):
    """A transition between stages, and the margins that count in it."""

    then: int
    parts: tuple[Margin, ...] = ()


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
        return int(np.prod(self.sizes))

    @property
    def over(self) -> int:
        return self.count - 1

    def without_window(self) -> Term | None:
        """An F G term that can never begin, since no decision's first sample is among those at which it may."""
        for term in self.terms:
            first = max(0, -(-(term.start - 1) // self.hold)) * self.hold + 1
            if term.kind == "FG" and first > term.c1 + term.c2:
                return term
        return None

    def moves(self, stage: int, decision: int) -> Iterator[Move]:
        """All transitions from a stage over a decision, those nearest to the end first."""
        each = np.unravel_index(stage, self.sizes)
        options = [
            tuple(self._choices(i, term, int(now), decision))
            for i, (term, now) in enumerate(zip(self.terms, each, strict=True))
        ]
        for chosen in product(*options):
            then = int(np.ravel_multi_index([move.then for move in chosen], self.sizes))
            yield Move(then, tuple(part for move in chosen for part in move.parts))

    def _choices(self, i: int, term: Term, now: int, decision: int) -> Iterator[Move]:
        """The transitions of one term."""
        t = decision * self.hold + 1 + np.arange(self.hold)
        inside = (term.start <= t) & (t <= term.end)
        if term.kind == "G":
            yield Move(0, (Margin(i, inside.tobytes(), True),) if inside.any() else ())
        elif term.kind == "F":
            if now == 0 and inside.any():
                yield Move(1, (Margin(i, inside.tobytes(), False),))
            if now == 1 or t[-1] < term.end:
                yield Move(now)
        else:
            yield from self._window(i, term, now, int(t[0]))

    def _window(self, i: int, term: Term, now: int, first: int) -> Iterator[Move]:
        """A window begins with a decision: its first sample is that decision's first."""
        last, begins = self._lasts(term), term.start <= first <= term.c1 + term.c2
        if now == last:
            yield Move(last)
        elif now > 0 or begins:
            left = term.b - term.c2 + 1 - now * self.hold
            yield Move(now + 1, (Margin(i, (np.arange(self.hold) < left).tobytes(), True),))
        if now == 0 and first + self.hold <= term.c1 + term.c2:
            yield Move(0)

    def _lasts(self, term: Term) -> int:
        """Decisions that the window of an F G term lasts."""
        return -(-(term.b - term.c2 + 1) // self.hold)


_TIES = 1e-6
"""Robustness that differs by less, in units of the widest margin, is equal: rounding would else choose the action."""
_CACHED = 8  # tables of extremes in memory at a time


@dataclass(frozen=True)
class MaximinPolicy(StatePolicy):
    """One look ahead on the true system; it remembers the stage of each of its episodes."""

    model: Model
    grid: Grid
    actions: ActionSet
    stages: Stages
    later: Floats
    """(decisions + 1, stages, S): the best robustness from each decision on; the end has `most` if all is over."""
    most: float  # more than any margin; a state from which the formula cannot be satisfied is worth -most

    def episode(self) -> Callable[[Array, Integers, Array], Integers | Array]:
        stage = np.zeros(0, dtype=np.int64)

        def act(state: Array, t: Integers, memory: Array) -> Integers | Array:
            nonlocal stage
            if t[0] == 0:
                stage = self._first(state)[0]
            chosen, stage = self._choose(state, int(t[0]) // self.model.hold, stage)
            return self.actions.choices[chosen]

        return act

    def value(self, state: Array) -> Array:
        return self._first(state)[1]

    def _first(self, state: Array) -> tuple[Integers, Array]:
        """The best first stages and their values, given the sample at t = 0, which no action changes."""
        signals = self.model.system.signals(state)
        margins = [_margin(self.model, term)(signals) for term in self.stages.terms]
        best = np.full(len(state), -np.inf)
        stages = np.zeros(len(state), dtype=np.int64)
        for begun in self._beginnings():
            each = np.unravel_index(begun, self.stages.sizes)
            worth = self.grid.read(self.later[0, begun], state, -self.most)
            for margin, term, now in zip(margins, self.stages.terms, each, strict=True):
                if term.start == 0 and (term.kind == "G" or now):
                    worth = np.minimum(worth, margin)
            stages[worth > best], best = begun, np.maximum(best, worth)
        return stages, best

    def _beginnings(self) -> list[int]:
        """F terms whose interval includes t = 0 may be over then."""
        free = [2 if term.kind == "F" and term.start == 0 else 1 for term in self.stages.terms]
        return [int(np.ravel_multi_index(each, self.stages.sizes)) for each in np.ndindex(*free)]

    def _choose(self, state: Array, decision: int, stage: Integers) -> tuple[Integers, Integers]:
        count, rows = len(self.actions), len(state)
        path, samples = simulated(self.model, np.tile(state, (count, 1)), np.repeat(self.actions.vectors, rows, axis=0))
        margins = [_margin(self.model, term)(samples[1:]).T for term in self.stages.terms]
        worth, then = np.full(count * rows, -np.inf), np.zeros(count * rows, dtype=np.int64)
        for now in np.unique(stage):
            mine = np.tile(stage == now, count)
            for move in self.stages.moves(int(now), decision):
                value = self.grid.read(self.later[decision + 1, move.then], path[-1, mine], -self.most)
                for part in move.parts:
                    value = np.minimum(value, part.extreme(margins[part.term][mine]))
                better = value > worth[mine] + self._tie  # equals go to the first move, which is nearest to the end
                places = np.flatnonzero(mine)[better]
                worth[places], then[places] = value[better], move.then
        by_action = worth.reshape(count, rows)
        chosen = (by_action >= by_action.max(axis=0) - self._tie).argmax(axis=0)
        return chosen, then[chosen * rows + np.arange(rows)]

    @property
    def _tie(self) -> float:
        return _TIES * self.most


def plan(model: Model, grid: Grid, actions: ActionSet) -> MaximinPolicy:
    """Solve for the robustness of the formula that the referee scores.

    The windows of an F G term begin with a decision's first sample. The value is a lower bound if others could be
    better. Raises `Unsuitable` if the formula is outside the fragment of eq. 2, an F G term has no such window, or the
    tables take too much memory.
    """
    stages = Stages(_terms(model), model.hold)
    if idle := stages.without_window():
        raise Unsuitable(
            f"{idle.formula}: none of its windows begins with a decision, every {model.hold} samples from 1"
        )
    each = len(stages.terms) * model.hold + _CACHED + 2 + len(grid.axes)
    numbers = stages.count * (model.decisions + 1) + len(actions) * each
    refuse_beyond(4e-9 * grid.size * numbers, f"a grid of {grid} points with {stages.count} stages of the formula")
    tables = _Margins(model, grid, actions, stages)
    next_ = sweep(model, grid, actions, (tables.observe,))
    next_.at[tables.undefined()] = -1
    decisions, most = model.decisions, tables.bound()
    later = np.full((decisions + 1, stages.count, grid.size), -most, np.float32)
    later[decisions, stages.over] = most
    free = np.full(tables.shape, most, np.float32)
    for d in reversed(range(decisions)):
        for stage in range(stages.count):
            for move in stages.moves(stage, d):
                paid = free
                for part in move.parts:
                    paid = np.minimum(paid, tables.at(part))
                reach_best(later[d + 1, move.then], *next_, grid.strides, paid, -most, later[d, stage])
    return MaximinPolicy(model, grid, actions, stages, later, most)


def _terms(model: Model) -> tuple[stl.Term, ...]:
    try:
        return tuple(map(_simpler, stl.fragment(model.formula)))
    except stl.FragmentError as error:
        raise Unsuitable(str(error)) from error


def _simpler(term: stl.Term) -> stl.Term:
    """An F G term with one window as a G term, one with windows of one sample as an F term: they may begin anywhere."""
    if term.kind == "FG" and (term.a == term.c1 or term.b == term.c2):
        return stl.Term("G" if term.a == term.c1 else "F", term.start, term.end, 0, 0, term.psi)
    return term


def _margin(model: Model, term: stl.Term) -> Callable[[Array], Array]:
    return stl.margin(term.psi, model.method.specification.signals)


class _Margins:
    """The margins of each term at all samples of each action from each state, and their extremes."""

    def __init__(self, model: Model, grid: Grid, actions: ActionSet, stages: Stages) -> None:
        terms = stages.terms
        self.shape = len(actions), grid.size
        self._margins = np.empty((len(terms), *self.shape, model.hold), np.float32)
        self._values = [_margin(model, term) for term in terms]
        self._cache = dict[Margin, Floats]()

    def observe(self, action: int, samples: Array) -> None:
        for i, margin in enumerate(self._values):
            self._margins[i, action] = margin(samples[1:]).T

    def undefined(self) -> Truth:
        """(A, S): whether a margin has no value at some sample, which the referee refuses. It becomes the least."""
        found: Truth = np.isnan(self._margins)
        self._margins[found] = -np.inf
        return np.asarray(found.any(axis=(0, 3)))

    def bound(self) -> float:
        """More than any margin, once all are noted; infinite ones, as of `true`, are clipped to it."""
        most = 1.5 * float(max(self._margins.max(), -self._margins.min()))
        if np.isinf(most):
            finite = self._margins[np.isfinite(self._margins)]
            most = 1.5 * float(np.abs(finite).max(initial=0)) or 1.0
            np.clip(self._margins, -most, most, out=self._margins)
        return most

    def at(self, part: Margin) -> Floats:
        if part not in self._cache:
            if len(self._cache) >= _CACHED:
                self._cache.pop(next(iter(self._cache)))
            self._cache[part] = np.empty(self.shape, np.float32)
            extremes(self._margins[part.term], np.frombuffer(part.active, np.bool_), part.least, self._cache[part])
        return self._cache[part]
