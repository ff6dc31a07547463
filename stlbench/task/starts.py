"""Initial states: drawn for training, laid out on a fixed grid for the referee."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import count as naturals
from itertools import islice
from math import isqrt

import numpy as np

from stlbench.contract import Array
from stlbench.errors import UsageError
from stlbench.task.region import Region

_ROUNDS = 200
_ROUNDS_APART = 20


def sample(region: Region, generator: np.random.Generator, count: int) -> Array:
    """Draw `count` states uniformly from a region: (count, n). Raises `UsageError` where its condition is hopeless."""
    low, high = region.low, region.high
    drawn: list[Array] = []
    missing = count
    for _ in range(_ROUNDS):
        states = region.keep(generator.uniform(low, high, (missing, len(low))))
        drawn.append(states)
        missing -= len(states)
        if missing == 0:
            return np.concatenate(drawn)
    raise _hopeless(region)


def grid(region: Region, count: int) -> Array:
    """`count` states (count, n) that fill a region evenly, the same at every call.

    A coordinate that the region fixes is the same in all states; a region of one state repeats it. Raises `UsageError`
    where its condition is hopeless.
    """
    return next(_blocks(region, count))


def grid_apart(region: Region, count: int, begun: Callable[[Array], Array]) -> tuple[Array, Array]:
    """Two sets of initial states that have none in common: to report on, and to select checkpoints on.

    Args:
        region: where they lie.
        count: how many states in each set.
        begun: from points of the region to the states in which episodes begin, `System.initial_states`; several points
            may lead to one state.

    Returns:
        The states that `grid` leads to, (count, n); and others, which come next in the same sequence, (count, n). No
        state of the second set is there twice, unless a region has too few of them: then they are repeated, and where
        it has no others at all, the second set is the first.
    """
    blocks = _blocks(region, count)
    first = begun(next(blocks))
    seen, others = {_key(state) for state in first}, list[Array]()
    for block in islice(blocks, _ROUNDS_APART):
        for state in begun(block):
            if _key(state) not in seen:
                seen.add(_key(state))
                others.append(state)
        if len(others) >= count:
            break
    if not others:
        return first, first
    return first, np.resize(np.stack(others), (count, first.shape[1]))


def _key(state: Array) -> bytes:
    return (state + 0.0).tobytes()  # 0 and -0 are one number


def _blocks(region: Region, count: int) -> Iterator[Array]:
    """An even sequence of states, a Halton sequence without noise, in blocks (count, n)."""
    free = np.flatnonzero(region.low < region.high)
    if not len(free):
        if not len(region.keep(region.low[None])):
            raise UsageError(f"initial states: the one state breaks the condition '{region.where}'")
        while True:
            yield np.repeat(region.low[None], count, axis=0)
    rest, drawn = np.empty((0, len(region.low))), 0
    while True:
        for _ in range(_ROUNDS):
            if len(rest) >= count:
                break
            states = np.tile(region.low, (count, 1))
            states[:, free] += _halton(drawn + 1, count, len(free)) * (region.high - region.low)[free]
            drawn += count
            rest = np.concatenate([rest, region.keep(states)])
        else:
            raise _hopeless(region)
        yield rest[:count]
        rest = rest[count:]


def _halton(first: int, count: int, dimensions: int) -> Array:
    """Points `first`, `first` + 1, ... of Halton's sequence in [0, 1), (count, dimensions), whose point 0 is 0.

    Coordinate i of point n has the digits of n in base p_i, the i-th prime, mirrored at the point (J. H. Halton,
    Numerische Mathematik 2, 1960). Written out, as SciPy's takes a second of every process to import.
    """
    points = np.zeros((count, dimensions))
    for i, prime in enumerate(islice(_primes(), dimensions)):
        number, weight = np.arange(first, first + count), 1.0 / prime
        while number.any():
            points[:, i] += number % prime * weight
            number, weight = number // prime, weight / prime
    return points


def _primes() -> Iterator[int]:
    return (n for n in naturals(2) if all(n % divisor for divisor in range(2, isqrt(n) + 1)))


def _hopeless(region: Region) -> UsageError:
    return UsageError(f"initial states: the condition '{region.where}' holds (almost) nowhere in the box")
