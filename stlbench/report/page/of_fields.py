"""Charts of the methods over all tasks: interquartile means, performance profiles, ranks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from stlbench.report.figures.across import SCALE, place, profiles, ticks
from stlbench.report.figures.palette import COLOURS, LINES
from stlbench.report.page.chart import Chart, Trace, band, colour, dash, frame, numbers, plain, short, shown
from stlbench.report.statistics.across import Estimate
from stlbench.report.tables.across import Aggregate, Field, aggregates

__all__ = ["across"]


def across(field: Field, key: str) -> list[Chart]:
    """The charts of one field; their keys begin with `key`."""
    found = aggregates(field)
    lowest = min(score for entry in field.entries for seeds in entry.scores for score in seeds)
    places, texts = zip(*ticks(lowest), strict=True)
    scores: dict[str, Any] = {
        "title": {"text": f"score<br>{SCALE.replace(', ', '<br>')}"},
        "tickvals": numbers(places),
        "ticktext": list(texts),
    }
    of = f"(tasks: {field.name}; budget {field.budget}, track {field.track})"
    rank: dict[str, Any] = {"title": {"text": "mean rank, 1 is the best"}, "dtick": 1}
    return [
        _dots(f"{key}-iqm", f"Interquartile mean {of}", found, lambda each: each.middle, (scores, place)),
        _dots(f"{key}-rank", f"Rank {of}", found, lambda each: each.rank, (rank, float)),
        _profiles(f"{key}-profile", f"Performance profile {of}", field, scores),
    ]


def _look(row: int) -> tuple[str, str]:
    """Colour and dash of a method, as the figures have them."""
    return colour(COLOURS[row % len(COLOURS)]), dash(LINES[row // len(COLOURS) % len(LINES)])


_Scale = tuple[dict[str, Any], Callable[[float], float]]
"""The axis, and where a value stands on it."""


def _dots(
    key: str, title: str, found: Sequence[Aggregate], estimate: Callable[[Aggregate], Estimate], scale: _Scale
) -> Chart:
    """A point and its interval for each method."""
    axis, at = scale
    data = [_dot(row, each.entry.method, estimate(each), at) for row, each in enumerate(found)]
    names = [short(each.entry.method) for each in found]
    rows = {"tickvals": list(range(len(found))), "ticktext": names, "range": [len(found) - 0.5, -0.5]}
    label = f"{title}: {len(found)} methods with 95 % intervals; the table of aggregates has the numbers"
    return Chart(key, title, label, data, frame(axis, rows), 100 + 34 * len(found))


def _dot(row: int, method: str, estimate: Estimate, at: Callable[[float], float]) -> Trace:
    value, ends = estimate
    said = f"{value:.4g}" + (f" [{ends.low:.4g}, {ends.high:.4g}]" if ends else "")
    dot: Trace = {
        **{"type": "scatter", "mode": "markers", "x": numbers([at(value)]), "y": [row], "text": [said]},
        **{"marker": {"color": _look(row)[0], "size": 11, "symbol": "diamond"}, "name": plain(method)},
        "hovertemplate": "%{text}<extra>%{fullData.name}</extra>",
    }
    if ends is not None:
        high, low = numbers([at(ends.high) - at(value), at(value) - at(ends.low)])
        dot["error_x"] = {"type": "data", "symmetric": False, "array": [high], "arrayminus": [low]}
        dot["error_x"] |= {"color": _look(row)[0], "thickness": 2, "width": 0}
    return dot


def _profiles(key: str, title: str, field: Field, scores: dict[str, Any]) -> Chart:
    """For each score the share of runs above it."""
    places, lines = profiles(field)
    data = list[Trace]()
    for row, (entry, shares) in enumerate(zip(field.entries, lines, strict=True)):
        of, style = _look(row)
        ends = [interval for _, interval in shares if interval is not None]
        if len(ends) == len(shares):
            low, high = ([100 * end for end in side] for side in zip(*ends, strict=True))
            data.append(band(places.tolist(), low, high, of, legendgroup=str(row)))
        data.append(
            {
                **{"type": "scatter", "mode": "lines", "x": numbers(places), "legendgroup": str(row)},
                **{"y": numbers(100 * value for value, _ in shares), "name": plain(entry.method)},
                **{"text": [f"{1 - 10**-at:.3g}" for at in places], "line": {"color": of, "width": 2, "dash": style}},
                "hovertemplate": "%{y:.1f} % of runs above %{text}<extra>%{fullData.name}</extra>",
            }
        )
    share = {"title": {"text": "runs with a higher score [%]"}, "range": [-3, 103]}
    legend = [
        shown(str(row), entry.method, _look(row)[0], LINES[row // len(COLOURS) % len(LINES)])
        for row, entry in enumerate(field.entries)
    ]
    label = f"{title}: share of runs above each score, {len(lines)} methods with 95 % bands"
    return Chart(key, title, label, data, frame(scores, share), 360, legend)
