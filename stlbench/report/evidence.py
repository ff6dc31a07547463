"""The evidence of trainings on drawn formulas for a method for a formula of the same form."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from stlbench.statistics import across
from stlbench.statistics.across import Estimate, Runs

NEAR = 1
"""A formula is of the same form where at most so many traits differ."""


class Trained(NamedTuple):
    """The results of methods on one drawn formula."""

    traits: frozenset[str]
    scores: Mapping[str, Sequence[float]]
    """Method -> for each seed the robustness, 0 at random and 1 the best known; only of methods that fit."""


class Rated(NamedTuple):
    """A method on the drawn formulas of this form that it fits."""

    method: str
    tasks: int
    score: Estimate
    behind: Estimate | None
    """The lead of the first method, on the formulas that both fit; None for the first, and without such."""

    @property
    def is_told_apart(self) -> bool:
        """Whether it is behind the first for sure."""
        return self.behind is not None and self.behind.interval is not None and self.behind.interval.low > 0


def alike(traits: frozenset[str], trained: Iterable[Trained], methods: Sequence[str]) -> list[Trained]:
    """Those of the same form that any of the methods fits: with the same traits, or with up to `NEAR` others.

    The same traits suffice where there are as many as an interval needs.
    """
    near = [each for each in trained if len(each.traits ^ traits) <= NEAR and any(map(each.scores.get, methods))]
    same = [each for each in near if each.traits == traits]
    return same if len(same) >= across.FEWEST else near


def rated(found: Sequence[Trained], methods: Sequence[str]) -> list[Rated]:
    """The methods with an interval there, the best first. Empty: too little is known of formulas like these."""
    runs = {method: [np.array(each.scores.get(method, ())) for each in found] for method in methods}
    fits = {method: [seeds for seeds in own if len(seeds)] for method, own in runs.items()}
    known = {method: across.sample_mean(own) for method, own in fits.items() if len(own) >= across.FEWEST}
    order = sorted(known, key=lambda method: -known[method].value)
    return [Rated(each, len(fits[each]), known[each], _behind(runs, order[0], each)) for each in order]


def _behind(runs: Mapping[str, Runs], first: str, other: str) -> Estimate | None:
    both = [(one, two) for one, two in zip(runs[first], runs[other], strict=True) if len(one) and len(two)]
    if first == other or not both:
        return None
    return across.sample_difference([one for one, _ in both], [two for _, two in both])
