"""The starts of a task's episodes: for the report, for the selection of checkpoints, in training, and elsewhere.

The sets share no start, so that no policy is reported from where it was trained or chosen. Starts of a system are
states, drawn for training and laid out on a fixed grid for the referee; those of an environment are seeds.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import count as naturals
from itertools import islice
from math import isqrt
from typing import Any

import numpy as np

from stlbench.contract import Array, System
from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.task.entry import MOST_STARTS, Region
from stlbench.task.file import Protocol, TaskFile

_REPORTED = 12031981
"""Seed of the report's random starts, and of nothing else."""


@dataclass(frozen=True)
class StateStarts:
    """States of a system, from the regions of the task file. Each set of starts is an array (count, n)."""

    file: TaskFile
    system: System

    @property
    def initial(self) -> Region:
        """The places of the referee's starts, in the system's coordinates."""
        assert self.file.initial is not None
        return self.file.initial

    def report_and_selection(self) -> tuple[Array, Array]:
        """The starts behind the report's main score, and those on which checkpoints are selected (`grid_apart`)."""
        return grid_apart(self.initial, self.file.starts, partial(begun, self.system))

    def at_random(self, count: int) -> Array:
        """The report's many random starts, the same for every method and seed of a task."""
        return sampled_states(self.system, self.initial, np.random.default_rng(_REPORTED), count)

    def of_protocol(self, protocol: Protocol) -> Array:
        """An even grid of the protocol's region, or of the task's."""
        return begun(self.system, grid(protocol.initial or self.initial, protocol.starts))

    def of_training(self, generator: np.random.Generator, count: int) -> Array:
        """The starts of that many training episodes. All randomness is the generator's."""
        return sampled_states(self.system, self.file.training.starts or self.initial, generator, count)


_SELECTION, _RANDOM, _PROTOCOLS, _FRESH, _TRAINING, _END = 10**5, 2 * 10**5, 3 * 10**5, 10**6, 2**30, 2**31
"""The beginnings of the ranges of seeds; those of the report's grid begin at 0."""


@dataclass(frozen=True)
class SeedStarts:
    """Seeds of a world whose state cannot be set, as arrays (count, 1); the same sets as those of `StateStarts`.

    The sets are ranges of whole numbers, apart from each other. 0 and up: the report; 100,000: selection; 200,000: the
    report's random starts; 300,000: protocols, all from the same seeds; from 1,000,000 below 2^30: `fresh`; from 2^30
    below 2^31: training.
    """

    file: TaskFile

    def report_and_selection(self) -> tuple[Array, Array]:
        return _seeds(0, self.file.starts), _seeds(_SELECTION, self.file.starts)

    def at_random(self, count: int) -> Array:
        return _seeds(_RANDOM, count)

    def of_protocol(self, protocol: Protocol) -> Array:
        return _seeds(_PROTOCOLS, protocol.starts)

    def of_training(self, generator: np.random.Generator, count: int) -> Array:
        return generator.integers(_TRAINING, _END, (count, 1)).astype(np.float64)

    def fresh(self, seed: int, count: int) -> Array:
        """Random seeds (count, 1) for work after a study, such as a certificate, by a seed of the user's."""
        return np.random.default_rng(seed).integers(_FRESH, _TRAINING, (count, 1)).astype(np.float64)


def _seeds(first: int, count: int) -> Array:
    if count > MOST_STARTS:
        raise UsageError(f"starts are seeds, at most {MOST_STARTS} of one kind, got {count}")
    return np.arange(first, first + count, dtype=np.float64)[:, None]


_ROUNDS = 200
"""Rounds of draws without enough states after which a condition counts as hopeless."""
_MANY = 256
"""Fewer states than this get more rounds, so that as many draws are made. Training asks for one state at the end of
each episode. In 200 rounds it would miss a condition that holds in 2 % of the box once in 57 calls."""
_ROUNDS_APART = 20
"""Blocks of the sequence that are searched for other states; a region may have too few of them."""


def sample(region: Region, generator: np.random.Generator, count: int) -> Array:
    """Draw `count` states uniformly from a region: (count, n). Raises `UsageError` where its condition is hopeless."""
    low, high = region.low, region.high
    drawn: list[Array] = []
    missing = count
    for _ in range(_ROUNDS * max(1, _MANY // max(1, count))):
        states = region.keep(generator.uniform(low, high, (missing, len(low))))
        drawn.append(states)
        missing -= len(states)
        if missing == 0:
            return np.concatenate(drawn)
    raise _hopeless(region)


def sampled_states(system: System, region: Region, generator: np.random.Generator, count: int) -> Array:
    """The states (count, n) in which episodes begin, drawn as by `sample`."""
    return begun(system, sample(region, generator, count))


def begun(system: System, points: Array) -> Array:
    """The states (N, n) at points of a region. Raises `UsageError` if the system gives another shape."""
    states: Any = system.initial_states(points)
    if type(states) is not np.ndarray or states.shape != (len(points), len(system.state)):
        shape = getattr(states, "shape", type(states).__name__)
        name = plugins.name_of("tasks", type(system)) or type(system).__name__
        rule = f"the contract says an array {(len(points), len(system.state))}"
        raise UsageError(f"task {name}: initial_states gives {shape}, {rule}")
    return states


def grid(region: Region, count: int) -> Array:
    """`count` states (count, n) that fill a region evenly, the same at every call.

    A coordinate that the region fixes is the same in all states; a region of one state repeats it. Raises `UsageError`
    if its condition is hopeless.
    """
    return next(_blocks(region, count))


def grid_apart(region: Region, count: int, begun: Callable[[Array], Array]) -> tuple[Array, Array]:
    """Two sets of initial states that have none in common: to report on, and to select checkpoints on.

    Args:
        region: the set in which they lie.
        count: the number of states in each set.
        begun: the map from points of the region to the states in which episodes begin, `System.initial_states`. Several
            points may lead to one state.

    Returns:
        The states that `grid` leads to, (count, n); and others, which come next in the same sequence, (count, n). A
        region with too few states repeats those of the second set; a region with no others has the first set twice.
    """
    blocks = _blocks(region, count)
    first = begun(next(blocks))
    seen, rest = {_key(state) for state in first}, list[Array]()
    for block in islice(blocks, _ROUNDS_APART):
        for state in begun(block):
            if _key(state) not in seen:
                seen.add(_key(state))
                rest.append(state)
        if len(rest) >= count:
            break
    if not rest:
        return first, first
    return first, np.resize(np.stack(rest), (count, first.shape[1]))


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
    rest, drawn, size = np.empty((0, len(region.low))), 0, max(count, _MANY)
    while True:
        for _ in range(_ROUNDS):
            if len(rest) >= count:
                break
            states = np.tile(region.low, (size, 1))
            # Point 0 of the sequence is left out: it is the region's lowest corner.
            states[:, free] += _halton(drawn + 1, size, len(free)) * (region.high - region.low)[free]
            drawn += size
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
    primes = (n for n in naturals(2) if all(n % divisor for divisor in range(2, isqrt(n) + 1)))
    for i, prime in enumerate(islice(primes, dimensions)):
        number, weight = np.arange(first, first + count), 1.0 / prime
        while number.any():
            points[:, i] += number % prime * weight
            number, weight = number // prime, weight / prime
    return points


def _hopeless(region: Region) -> UsageError:
    return UsageError(f"initial states: the condition '{region.where}' holds (almost) nowhere in the box")
