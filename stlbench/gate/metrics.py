"""What the gate compares of two cells, and how much of a loss is tolerated."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stlbench.gate.snapshot import Sample

__all__ = ["METRICS", "Metric", "absolute", "relative", "speed"]

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
    load: float = 0.0
    """An average loss that load from other processes explains."""
    columns: tuple[str, ...] = ()
    """Of a CPU time: the fields of a sample that it is made of, itself and its calibration."""

    @property
    def timing(self) -> bool:
        """A CPU time. Its gains scatter alike in all settings, so the scatter is taken from all of them together."""
        return bool(self.columns)

    def change(self, gain: float) -> float:
        """A gain for people: of a time, new over base; otherwise the gain itself."""
        return math.exp(-gain) if self.timing else gain

    def text(self, gain: float) -> str:
        """The change, with its unit."""
        return self.shown.format(self.change(gain))


LOAD = 1.1
"""How many times as long a calibrated time may be beside two busy processes, on average over ten seeds."""


def _timed(name: str, time: str, calibration: str, tolerated: float) -> Metric:
    """A CPU time over its calibration, of which `tolerated` times as much is not worse."""

    def value(sample: Sample) -> float | None:
        seconds, own = getattr(sample, time), getattr(sample, calibration)
        return seconds / own if seconds and own else None

    return Metric(name, value, speed, math.log(tolerated), "x{:.2f}", math.log(LOAD), (time, calibration))


METRICS = (
    Metric("robustness", lambda sample: sample.robustness_mean, relative, 0.05, "{:+.1%}"),
    Metric("satisfaction", lambda sample: sample.satisfaction, absolute, 0.05, "{:+.3f}"),
    _timed("CPU", "training_cpu_seconds", "training_calibration_seconds", 1.25),
    _timed("reward", "reward_nanoseconds", "reward_calibration_seconds", 1.5),
)
"""CPU: seconds of training; reward: nanoseconds of the method's reward per step; each divided by its calibration."""
