"""Initial states: drawn for training, laid out on a fixed grid for the referee."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array
from stlbench.errors import UsageError
from stlbench.task.file import Region

__all__ = ["grid", "sample"]

_ROUNDS = 200


def sample(region: Region, generator: np.random.Generator, count: int) -> Array:
    """Draw `count` states uniformly from a region: (count, n). Raises `UsageError` where its condition is hopeless."""
    low, high = region.low, region.high
    found: list[Array] = []
    missing = count
    for _ in range(_ROUNDS):
        states = region.keep(generator.uniform(low, high, (missing, len(low))))
        found.append(states)
        missing -= len(states)
        if missing == 0:
            return np.concatenate(found)
    raise UsageError(f"initial states: the condition '{region.where}' holds (almost) nowhere in the box")


def grid(region: Region, count: int, part: int = 0) -> Array:
    """`count` states (count, n) that fill a region evenly, the same at every call: a Halton sequence without noise.

    Different `part`s of the sequence have no state in common: part 0 is what the referee reports on, part 1 what
    checkpoints are selected on. A coordinate that the region fixes is the same in all states.
    """
    from scipy.stats import qmc

    free = np.flatnonzero(region.low < region.high)
    if not len(free):
        states = region.keep(region.low[None])
        if not len(states):
            raise UsageError(f"initial states: the one state breaks the condition '{region.where}'")
        return np.repeat(states, count, axis=0)
    wanted = count * (part + 1)
    points = qmc.Halton(d=len(free), scramble=False)
    points.fast_forward(1)
    found: list[Array] = []
    for _ in range(_ROUNDS):
        states = np.tile(region.low, (wanted, 1))
        states[:, free] += points.random(wanted) * (region.high - region.low)[free]
        found.append(region.keep(states))
        if sum(map(len, found)) >= wanted:
            return np.concatenate(found)[wanted - count : wanted]
    raise UsageError(f"initial states: the condition '{region.where}' holds (almost) nowhere in the box")
