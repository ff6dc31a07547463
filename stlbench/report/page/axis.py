"""Axes whose values span orders of magnitude, as the figures have them: plotly knows none that is linear around 0."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from stlbench.report.figures.scale import linear_threshold, symlog_ticks

_NUMBERS = 10
"""As many fit beside each other on the axis of a phone."""


@dataclass(frozen=True)
class Axis:
    """Where values stand."""

    threshold: float | None
    """Up to which it is linear; None where it is so everywhere."""
    low: float
    high: float

    def at(self, value: float) -> float:
        """The place of a value: a decade beyond the threshold is as long as the way from 0 to it."""
        if self.threshold is None or not math.isfinite(value):
            return value
        size = abs(value) / self.threshold
        return math.copysign(size if size <= 1 else 1 + math.log10(size), value)

    @property
    def range(self) -> tuple[float, float]:
        """Both edges of the chart, as places: a little more than the ends."""
        low, high = self.at(self.low), self.at(self.high)
        margin = 0.05 * (high - low) or 1.0
        return low - margin, high + margin

    def layout(self, title: str) -> dict[str, Any]:
        """The axis for plotly, with its title, which says where the logarithmic part begins."""
        common = {"range": list(self.range)}
        if self.threshold is None:
            return {"title": {"text": title}, **common}
        ticks = self._apart(symlog_ticks(self.threshold, self.low, self.high)[0])
        places = {"tickvals": [self.at(tick) for tick in ticks], "ticktext": [f"{tick:g}" for tick in ticks]}
        return {"title": {"text": f"{title}<br>logarithmic beyond ±{self.threshold:g}"}, **common, **places}

    def _apart(self, ticks: Sequence[float]) -> list[float]:
        """Those whose numbers do not touch on a phone: the outermost first, and always 0."""
        least, kept = (self.range[1] - self.range[0]) / _NUMBERS, [0.0]
        for tick in sorted(ticks, key=abs, reverse=True):
            if all(abs(self.at(tick) - self.at(other)) >= least for other in kept):
                kept.append(tick)
        return sorted(kept)


def axis_of(groups: Sequence[Iterable[float]], ends: Iterable[float]) -> Axis:
    """The axis on which values of each group can be told apart; it has room for the ends, and for 0."""
    finite = [value for value in ends if math.isfinite(value)]
    low, high = min([0.0, *finite]), max([0.0, *finite])
    return Axis(linear_threshold(groups, max(-low, high)), low, high)
