"""How fast this machine is just now, by a fixed workload: CPU times over it can be compared with those of elsewhere.

The parent measures it whenever a cell ends, while the other workers go on: under the load that the cells see, and
without a process of its own. A cell's calibration is the geometric mean of the measurements before and after it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stlbench.result import Result
from stlbench.study.ledger import Ledger

__all__ = ["CALIBRATION", "CalibratedLedger", "measure", "workload"]

CALIBRATION = "calibration_seconds"
"""Name of a cell's calibration in its provenance and in a reference."""

UPDATES = 96
"""Updates per pass: about 10 ms, long against the clock and short against a cell."""

PASSES = 5
"""Odd: the median leaves out the passes that something else disturbed."""

BATCH = 32
"""So small that OpenBLAS uses one thread, whatever the environment says: CPU time would count the others too."""

Floats = NDArray[np.float32]


def measure() -> float:
    """CPU seconds of one pass of the workload: the median of a few. Takes about a twentieth of a second."""
    seconds = []
    for _ in range(PASSES):
        begin = time.process_time()
        workload()
        seconds.append(time.process_time() - begin)
    return sorted(seconds)[PASSES // 2]


def workload(updates: int = UPDATES) -> float:
    """Train a network 8-64-64-32 with Adam, small products and elementwise work as in an agent's updates; the loss.

    A change of it makes every reference meaningless, which is why a test has the loss.
    """
    generator = np.random.default_rng(0)
    inputs, goal = (_normal(generator, BATCH, width) for width in (8, 32))
    layers = [_normal(generator, *shape) / np.float32(8) for shape in ((8, 64), (64, 64), (64, 32))]
    moments = [(np.zeros_like(layer), np.zeros_like(layer)) for layer in layers]
    loss = math.nan
    for _ in range(updates):
        loss = _update(layers, moments, inputs, goal)
    return loss


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


class CalibratedLedger(Ledger):
    """A ledger that adds to the provenance of each result what the machine's calibration was meanwhile.

    Args:
        path: the file.
        stamp: further provenance. A result with another one, or without calibration, does not count as finished:
            it was computed by other code or on another machine, and may not speak for this one.
    """

    def __init__(self, path: Path, stamp: Mapping[str, str]) -> None:
        super().__init__(path)
        self._stamp = dict(stamp)
        self._before: float | None = None

    def record(self, result: Result) -> None:
        """Measure, and write the result."""
        after = measure()
        seconds = math.sqrt((self._before or after) * after)
        self._before = after
        super().record(replace(result, provenance={**result.provenance, **self._stamp, CALIBRATION: f"{seconds:.6f}"}))

    def finished(self, keys: Iterable[str], retry: bool = False) -> set[str]:
        """See `Ledger.finished`; only what has a calibration and this stamp."""
        results, stamp = self.results(super().finished(keys, retry)), self._stamp.items()
        return {result.key for result in results if stamp <= result.provenance.items() and _calibrated(result)}


def _calibrated(result: Result) -> bool:
    return CALIBRATION in result.provenance
