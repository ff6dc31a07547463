"""How fast this machine is just now, by fixed workloads: CPU times over theirs can be compared with those of elsewhere.

There are two, since load slows things by unlike factors. A training gathers rows all over a replay of some megabytes,
so whatever else uses the caches slows it; its calibration does the same, and its middle pass counts. A reward's time is
the least of several rounds that fit into a cache, and so is its calibration. docs/ci.md has the figures.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from statistics import median

import numpy as np
from numpy.typing import NDArray

__all__ = ["CALIBRATIONS", "Speed", "measure", "workload"]

CALIBRATIONS = ("training_calibration_seconds", "reward_calibration_seconds")
"""Names of a cell's calibrations in its provenance and in a reference."""

TRAINING_PASSES, TRAINING_UPDATES = 9, 40
"""Passes of some 8 ms each: long against the clock, together short against a cell."""

REWARD_PASSES, REWARD_UPDATES = 15, 24
"""Passes of about 2 ms, less than a time slice: some of them are disturbed by nothing."""

BATCH = 32
"""So small that OpenBLAS uses one thread, whatever the environment says: CPU time would count the others too."""

REPLAY, GATHERED = 65536, 512
"""Rows of the replay, 8 numbers and 8 more each, which are 4 MiB; and how many of them an update reads."""

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Speed:
    """CPU seconds of each pass of the two workloads."""

    training: tuple[float, ...]
    reward: tuple[float, ...]

    def __add__(self, other: Speed) -> Speed:
        return Speed(self.training + other.training, self.reward + other.reward)

    @property
    def provenance(self) -> dict[str, str]:
        """By the names of `CALIBRATIONS`: the middle of the passes, and the least."""
        return dict(zip(CALIBRATIONS, (f"{median(self.training):.6g}", f"{min(self.reward):.6g}"), strict=True))


def measure() -> Speed:
    """Run both workloads a few times. Takes about a tenth of a second."""
    return Speed(
        _passes(TRAINING_PASSES, lambda number: workload(TRAINING_UPDATES, GATHERED, number)),
        _passes(REWARD_PASSES, lambda _: workload(REWARD_UPDATES)),
    )


def _passes(count: int, work: Callable[[int], object]) -> tuple[float, ...]:
    """CPU seconds of each pass, after one that does not count: it makes the arrays and fills the caches."""
    work(0)
    seconds = []
    for number in range(1, count + 1):
        begin = time.process_time()
        work(number)
        seconds.append(time.process_time() - begin)
    return tuple(seconds)


def workload(updates: int, gathered: int = 0, seed: int = 0) -> float:
    """Train a network 8-64-64-32 with Adam, small products and elementwise work as in an agent's updates; the loss.

    A change of it makes every reference meaningless, which is why a test has the loss.

    Args:
        updates: how many.
        gathered: rows that each update reads from each half of the replay; the first are its inputs. 0: the same
            inputs every time.
        seed: says which rows.
    """
    generator = np.random.default_rng(0)
    inputs, goal = (_normal(generator, BATCH, width) for width in (8, 32))
    layers = [_normal(generator, *shape) / np.float32(8) for shape in ((8, 64), (64, 64), (64, 32))]
    moments = [(np.zeros_like(layer), np.zeros_like(layer)) for layer in layers]
    chosen, loss = np.random.default_rng(seed), math.nan
    for _ in range(updates):
        if gathered:
            rows = chosen.integers(0, REPLAY, gathered)
            before, after = (half[rows] for half in _replay())
            inputs = (before + after)[:BATCH]
        loss = _update(layers, moments, inputs, goal)
    return loss


@lru_cache(maxsize=1)
def _replay() -> tuple[Floats, Floats]:
    """What is observed before and after each of `REPLAY` steps, as agents keep it."""
    one, two = np.random.default_rng(1).random((2, REPLAY, 8), dtype=np.float32)
    return one, two


def _normal(generator: np.random.Generator, rows: int, columns: int) -> Floats:
    return generator.standard_normal((rows, columns), dtype=np.float32)


def _update(layers: list[Floats], moments: list[tuple[Floats, Floats]], inputs: Floats, goal: Floats) -> float:
    """One step down the mean squared error, in place; the error before it."""
    kept = [inputs]
    for layer in layers[:-1]:
        kept.append(np.maximum(kept[-1] @ layer, 0))
    error = kept[-1] @ layers[-1] - goal
    loss, back = float(np.mean(error**2)), error / len(error)
    for layer, (first, second), arrived in zip(layers[::-1], moments[::-1], kept[::-1], strict=True):
        gradient, back = arrived.T @ back, (back @ layer.T) * (arrived > 0)
        first += 0.1 * (gradient - first)
        second += 0.001 * (gradient**2 - second)
        layer -= 0.001 * first / (np.sqrt(second) + 1e-8)
    return loss
