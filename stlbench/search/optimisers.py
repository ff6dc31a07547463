"""SciPy's global optimisers, and points at random, over a unit cube; each asks for many values at a time.

Those that ask for one value at a time run as several searches side by side (`abreast`): each with a seed of its own,
or in a part of the cube of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import count, pairwise, product
from typing import Any

import numpy as np

from stlbench.search.abreast import Scalar, abreast
from stlbench.search.objective import Objective

Optimiser = Callable[[Objective, int], None]
"""Minimises an objective until it raises `Enough`, or ends before; all that is random comes from the seed."""

_POPULATION = 32
"""Points in a generation of differential evolution, about. Few, so that it comes together and begins anew often:
robustness has many local minima."""
_AT_RANDOM, _FIRST = 0.2, 64
"""The part of its evaluations that are points at random, and how many of them are in the first batch."""
_COPIES = 32
"""Searches side by side, about."""


def at_random(objective: Objective, seed: int) -> None:
    """Points drawn uniformly from the region of starts: what the others are compared with."""
    _draw(objective, np.random.default_rng(seed), objective.evaluations)


def _draw(objective: Objective, generator: np.random.Generator, count: int) -> None:
    """So many points at random, in batches that grow: where failures are common, the first are soon met."""
    while objective.count < count:
        batch = min(max(_FIRST, objective.count), objective.subject.rows, count - objective.count)
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
            maxiter=objective.evaluations,
            popsize=max(5, -(-_POPULATION // size)),
            init="halton",
            tol=1e-2,
            polish=False,
            updating="deferred",
            vectorized=True,
            rng=generator,
        )


def dual_annealing(objective: Objective, seed: int) -> None:
    """Generalised simulated annealing with local searches (Y. Xiang and others 1997), several chains side by side."""
    from scipy import optimize

    def chain(own: int, value: Scalar) -> None:
        for generator in _generators(own):
            optimize.dual_annealing(value, [(0.0, 1.0)] * objective.box.size, rng=generator)

    own_seeds = np.random.SeedSequence(seed).generate_state(_COPIES).tolist()
    abreast([partial(chain, own) for own in own_seeds], objective.of_cube)


def direct(objective: Objective, seed: int) -> None:
    """Dividing rectangles (D. Jones and others 1993), one search in each part of the cube; it has no randomness."""
    from scipy import optimize

    most = objective.evaluations
    options: dict[str, Any] = {"maxfun": most, "maxiter": most, "vol_tol": 0.0, "len_tol": 0.0}
    abreast([partial(_bounded, optimize.direct, part, options) for part in _parts(objective)], objective.of_cube)


def shgo(objective: Objective, seed: int) -> None:
    """Simplicial homology (S. Endres and others 2018), one search in each part of the cube; it has no randomness.

    It samples, finds the points that are below their neighbours, and searches locally from each.
    """
    from scipy import optimize

    parts = _parts(objective)
    each = 1 << max(4, (objective.evaluations // (4 * len(parts))).bit_length() - 1)
    options = {"n": each, "iters": 1, "sampling_method": "sobol"}
    abreast([partial(_bounded, optimize.shgo, part, options) for part in parts], objective.of_cube)


def _bounded(search: Callable[..., object], bounds: Any, options: dict[str, Any], value: Scalar) -> None:
    search(value, bounds, **options)


def _parts(objective: Objective) -> list[list[tuple[float, float]]]:
    """A grid of about `_COPIES` parts of the cube: the bounds of each."""
    size = objective.box.size
    edges = np.linspace(0.0, 1.0, max(1, round(_COPIES ** (1 / size))) + 1).tolist()
    return [list(part) for part in product(pairwise(edges), repeat=size)]


def _generators(seed: int) -> Iterator[np.random.Generator]:
    """One for each time that a search begins anew."""
    return (np.random.default_rng([seed, again]) for again in count())


OPTIMISERS: dict[str, Optimiser] = {
    "differential-evolution": differential_evolution,
    "dual-annealing": dual_annealing,
    "direct": direct,
    "shgo": shgo,
    "random": at_random,
}
"""By the names that users say."""
DEFAULT, OF_SEEDS = "differential-evolution", "random"
"""The optimiser where none is named, of states and of seeds."""
