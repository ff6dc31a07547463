"""cfer: flags, learned from counterfactual experiences too (Wang, Yin et al., L-CSS 2024)."""

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from stlbench.contract import Array, Integers, Specification
from stlbench_methods.flag import Flag

_Q = math.exp(-1)  # the ratio of the weights of a flag that is farther by 1


class Cfer(Flag):
    """The flags and the reward of `flag`; every transition may be learned from other flags too.

    A transition changes other flags in a known way, as that depends on the predicates alone. An agent that asks for
    counterfactuals (`dqn`) stores each transition again with flags g in place of f. Their probability is proportional
    to exp(-||g - f||_1), flags counted in samples, as the source replays them. For another agent this is `flag`.

    Args:
        beta: as of `flag`.
        flags: `all`: each flag from 0 to full. `published`: the source's program leaves out the full flag. It has no
            experience of a window G that is satisfied, or of a window F whose predicate holds now.
        counterfactuals: the number of times each transition is stored again.

    Raises:
        Unsuitable: as `flag`.
    """

    def __init__(
        self,
        specification: Specification,
        *,
        beta: Annotated[float, Field(gt=0)] = 50.0,
        flags: Literal["all", "published"] = "all",
        counterfactuals: Annotated[int, Field(ge=0)] = 1,
    ) -> None:
        super().__init__(specification, beta=beta)
        self.counterfactuals = counterfactuals
        self._last = self._flags.full - (flags == "published")

    def counterfactual(self, signals: Array, t: Integers, memory: Array, chance: Array) -> Array:
        """Flags (N, m), each drawn on its own; the copy's own are among them."""
        below, above = memory, np.maximum(self._last - memory, 0)
        own = memory <= self._last
        under, over = _weight(below), _weight(above)
        drawn = chance * (under + own + over)
        beyond = np.maximum(drawn - under - own, 0)
        lower = memory - np.minimum(_distance(drawn), below)
        higher = memory + np.minimum(_distance(beyond), above)
        return np.where(drawn < under, lower, np.where(drawn < under + own, memory, higher))


def _weight(count: Array) -> Array:
    """exp(-1) + ... + exp(-count), the weight of all flags at distances from 1 to `count`."""
    weight: Array = _Q * (1 - _Q**count) / (1 - _Q)
    return weight


def _distance(drawn: Array) -> Array:
    """The least distance, at least 1, up to which the weights sum up to more than `drawn`."""
    # All weights together sum up to _Q / (1 - _Q): rounding must not leave less than nothing of them.
    left = np.maximum(1 - drawn * (1 - _Q) / _Q, np.finfo(float).tiny)
    distance: Array = np.floor(-np.log(left)) + 1
    return distance
