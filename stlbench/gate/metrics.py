"""What the gate compares of two cells, and how much of a loss is tolerated."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stlbench.gate.snapshot import Sample

Floats = NDArray[np.float64]


def relative(base: Floats, new: Floats) -> Floats:
    """Gain over the size of the base, per seed: its own, or half the mean over the seeds where that is more."""
    size = np.abs(base)
    size = np.maximum(size, size.mean() / 2)
    gain: Floats = (new - base) / np.where(size > 0, size, 1.0)
    return gain


def absolute(base: Floats, new: Floats) -> Floats:
    """Gain in the unit of the metric."""
    return new - base


def speed(base: Floats, new: Floats) -> Floats:
    """Logarithm of how many times faster."""
    gain: Floats = np.log(base) - np.log(new)
    return gain


@dataclass(frozen=True)
class Metric:
    """What is compared. Losses are in the unit of `gain`."""

    name: str
    value: Callable[[Sample], float | None]
    """None where it was not measured."""
    gain: Callable[[Floats, Floats], Floats]
    tolerated: float
    """The largest average loss that is not worse."""
    shown: str
    """How a change is written (see `change`)."""

    @property
    def is_cost(self) -> bool:
        """A CPU time: two of them say something only if they were measured by turns."""
        return self.gain is speed

    def change(self, gain: float) -> float:
        """A gain for people: of a cost, new over base; otherwise the gain itself."""
        return math.exp(-gain) if self.is_cost else gain

    def text(self, gain: float) -> str:
        """The change, with its unit."""
        return self.shown.format(self.change(gain))


QUALITIES = (
    Metric("robustness", lambda sample: sample.robustness_mean, relative, 0.05, "{:+.1%}"),
    Metric("satisfaction", lambda sample: sample.satisfaction, absolute, 0.05, "{:+.3f}"),
)
"""The same code gives the same bits."""

COSTS = (
    Metric("CPU", lambda sample: sample.training_cpu_seconds, speed, math.log(1.3) / 2, "x{:.2f}"),
    Metric("reward", lambda sample: sample.reward_nanoseconds, speed, math.log(1.5), "x{:.2f}"),
)
"""CPU: seconds of training; reward: nanoseconds of the method's reward per step. A limit in the middle between no loss
and the loss to be found makes both errors equally rare: 1.3 times for the CPU, and 2.25 for the much noisier reward."""

METRICS = QUALITIES + COSTS
