"""SciPy's global optimisers and random points, over a unit cube, in batches; and their objective, the robustness of
the task's formula as a function of the start.

Optimisers that ask for one value at a time run as several searches at once (`side_by_side`): each has its own seed, or
its own part of the cube.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import count, pairwise, product
from operator import itemgetter
from queue import SimpleQueue
from threading import Thread
from typing import Any

import numpy as np

from stlbench.contract import Array
from stlbench.search.actor import VERDICTS, Actor, Box, Seeds, Verdict

FAR = 1e6  # the value of a point outside the region of starts, plus its distance: worse than all points inside
_OUTSIDE, _FEW = 20, 100
"""The most points for each evaluation, of so many evaluations at least. Points outside the region are not simulated."""


class Enough(Exception):
    """The search is over: a counterexample was found, all evaluations are used, or a simulation failed."""


@dataclass(frozen=True)
class Worst:
    """The least robust start so far of those with the worst verdict."""

    point: Array  # (n,), of the space of starts
    trace: Array  # (T + 1, k), as it was recorded
    robustness: float
    verdict: Verdict

    @property
    def _order(self) -> tuple[int, float]:
        return VERDICTS.index(self.verdict), self.robustness

    def __lt__(self, other: Worst) -> bool:
        return self._order < other._order


class Objective:
    """Robustness from points, in batches; keeps the worst, and says by `Enough` when to stop."""

    def __init__(
        self, actor: Actor, space: Box | Seeds, evaluations: int, least: bool, progress: Callable[[int, float], None]
    ) -> None:
        self.actor, self.space, self.evaluations, self.least = actor, space, evaluations, least
        self._progress = progress
        self.count = self._points = 0
        self.worst: Worst | None = None
        self.firsts: dict[Verdict, int] = {}
        """The first evaluation, from 1, with each verdict."""
        self.failure: Exception | None = None
        """An exception of a simulation. SciPy would take some of them for its own."""

    @property
    def box(self) -> Box:
        assert isinstance(self.space, Box)
        return self.space

    def of_cube(self, unit: Array) -> Array:
        """Values (N,) at points (N, size) of the unit cube. Raises `Enough` when the search is over."""
        box = self.box
        points = box.points(unit)
        inside = box.inside(points)
        values = np.empty(len(points))
        if not inside.all():
            values[~inside] = FAR + box.violation(points[~inside])
        self._points += len(points)
        if inside.any():
            values[inside] = np.minimum(self.of_points(points[inside]), FAR)  # robustness may be infinite
        if self._points >= _OUTSIDE * max(self.evaluations, _FEW):
            raise Enough
        return values

    def of_points(self, points: Array) -> Array:
        """Robustness (N,) from points (N, n) of the region. Raises `Enough` as `of_cube` does."""
        parts = []
        for first in range(0, len(points), self.actor.rows):
            part = points[first : first + self.actor.rows][: self.evaluations - self.count]
            try:
                parts.append(self._simulate(part))
            except Exception as error:
                self.failure = error
                raise Enough from error
            if self.count >= self.evaluations or (self.firsts.keys() - {"satisfied"} and not self.least):
                raise Enough
        return np.concatenate(parts)

    def _simulate(self, points: Array) -> Array:
        played = self.actor.play(points)
        traces, robustness, verdicts = played.traces, played.robustness, played.verdicts
        least = int(np.lexsort((robustness, verdicts))[0])
        worst = Worst(points[least], traces[least].copy(), float(robustness[least]), VERDICTS[verdicts[least]])
        if self.worst is None or worst < self.worst:
            self.worst = worst
        for place, row in zip(*np.unique(verdicts, return_index=True), strict=True):
            self.firsts.setdefault(VERDICTS[place], self.count + int(row) + 1)
        self.count += len(points)
        self._progress(self.count, self.worst.robustness)
        return robustness


Optimiser = Callable[[Objective, int], None]
"""Minimises an objective until it raises `Enough`, or ends before. The seed determines all random numbers."""

_POPULATION = 32
"""Points in a generation of differential evolution, about. Few points converge and begin anew often, since robustness
has many local minima."""
_AT_RANDOM, _FIRST = 0.2, 64  # the share of evaluations at random points, and the size of the first batch of them
_COPIES = 32  # searches at once, about


def at_random(objective: Objective, seed: int) -> None:
    """Points drawn uniformly from the region of starts: the baseline of the other optimisers."""
    _draw(objective, np.random.default_rng(seed), objective.evaluations)


def _draw(objective: Objective, generator: np.random.Generator, count: int) -> None:
    """`count` random points, in batches that grow: frequent failures are then found soon."""
    while objective.count < count:
        batch = min(max(_FIRST, objective.count), objective.actor.rows, count - objective.count)
        objective.of_points(objective.space.draw(generator, batch))


def differential_evolution(objective: Objective, seed: int) -> None:
    """R. Storn and K. Price (1997), a generation at a time; begins anew where its points have come together.

    A part of the evaluations are points at random, first: failures that robustness does not lead to are met there.
    """
    from scipy import optimize

    minimise: Any = optimize.differential_evolution  # its annotations know no batches
    size = objective.box.size
    _draw(objective, np.random.default_rng(seed), round(_AT_RANDOM * objective.evaluations))
    for generator in _generators(seed):
        minimise(
            lambda points: objective.of_cube(points.T),
            [(0.0, 1.0)] * size,
            maxiter=objective.evaluations,  # so many that `Enough` ends it
            popsize=max(5, -(-_POPULATION // size)),  # points for each coordinate, however many these are
            init="halton",
            tol=1e-2,
            polish=False,  # it would ask for one value at a time
            updating="deferred",
            vectorized=True,
            rng=generator,
        )


def dual_annealing(objective: Objective, seed: int) -> None:
    """Generalised simulated annealing with local searches (Y. Xiang and others 1997), several chains at once."""
    from scipy import optimize

    def chain(own: int, value: Scalar) -> None:
        for generator in _generators(own):
            optimize.dual_annealing(value, [(0.0, 1.0)] * objective.box.size, rng=generator)

    own_seeds = np.random.SeedSequence(seed).generate_state(_COPIES).tolist()
    side_by_side([partial(chain, own) for own in own_seeds], objective.of_cube)


def direct(objective: Objective, seed: int) -> None:
    """Dividing rectangles (D. Jones and others 1993), one search in each part of the cube; it has no randomness."""
    from scipy import optimize

    most = objective.evaluations  # with tolerances of 0, nothing but these ends a search
    _in_parts(objective, partial(optimize.direct, maxfun=most, maxiter=most, vol_tol=0.0, len_tol=0.0))


def shgo(objective: Objective, seed: int) -> None:
    """Simplicial homology (S. Endres and others 2018), one search in each part of the cube; it has no randomness.

    It samples, and searches locally from each point that is below its neighbours.
    """
    from scipy import optimize

    # a quarter of the evaluations samples, the rest searches locally; Sobol's points are even in powers of 2 alone
    each = 1 << max(4, (objective.evaluations // (4 * len(_parts(objective)))).bit_length() - 1)
    _in_parts(objective, partial(optimize.shgo, n=each, iters=1, sampling_method="sobol"))


def _in_parts(objective: Objective, search: Callable[..., object]) -> None:
    side_by_side([partial(search, bounds=part) for part in _parts(objective)], objective.of_cube)


def _parts(objective: Objective) -> list[list[tuple[float, float]]]:
    """A grid of about `_COPIES` parts of the cube: the bounds of each."""
    size = objective.box.size
    edges = np.linspace(0.0, 1.0, max(1, round(_COPIES ** (1 / size))) + 1).tolist()
    return [list(part) for part in product(pairwise(edges), repeat=size)]


def _generators(seed: int) -> Iterator[np.random.Generator]:
    """One for each new beginning of a search."""
    return (np.random.default_rng([seed, restart]) for restart in count())


OPTIMISERS: dict[str, Optimiser] = {
    "differential-evolution": differential_evolution,
    "dual-annealing": dual_annealing,
    "direct": direct,
    "shgo": shgo,
    "random": at_random,
}
"""Optimisers by name."""
DEFAULT, OF_SEEDS = "differential-evolution", "random"
"""The optimisers of states and of seeds, unless the user names one."""


Scalar = Callable[[Array], float]  # the value of a point (d,)


class _Stopped(Exception):
    """Ends a search that gets no further answer."""


def side_by_side(searches: Sequence[Callable[[Scalar], object]], values: Callable[[Array], Array]) -> None:
    """Run searches at once until all have ended, with all their questions answered in one batch.

    Each is called with a function from a point (d,) to its value. `values` maps points (m, d) to values (m,). An
    exception ends all searches, and is raised here. The points of a search depend on its own answers alone.
    """
    going, questions = set(range(len(searches))), SimpleQueue[tuple[int, Any]]()
    answers = [SimpleQueue[float | None]() for _ in searches]

    def run(number: int) -> None:
        def ask(point: Array) -> float:
            questions.put((number, np.array(point, dtype=np.float64)))
            if (answer := answers[number].get()) is None:
                raise _Stopped
            return answer

        try:
            searches[number](ask)
            questions.put((number, None))
        except BaseException as error:
            questions.put((number, error))

    threads = [Thread(target=run, args=(number,), daemon=True) for number in going]
    for thread in threads:
        thread.start()
    try:
        while going:
            # threads ask in any order: by their numbers, the batches are the same in each run
            points = dict(sorted((questions.get() for _ in going), key=itemgetter(0)))
            for number in [number for number, point in points.items() if not isinstance(point, np.ndarray)]:
                going.remove(number)
                if (error := points.pop(number)) is not None:
                    raise error
            if points:
                for number, value in zip(points, values(np.stack([*points.values()])).tolist(), strict=True):
                    answers[number].put(value)
    finally:
        for number in going:
            answers[number].put(None)
        for thread in threads:
            thread.join()
