"""Charts of the methods over all tasks: interquartile means, performance profiles, ranks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from stlbench.report.figures.across import SCALE, place, profiles, ticks
from stlbench.report.figures.palette import Colours, lines_of
from stlbench.report.page.chart import MUTED, Chart, Trace, band, colour, dash, frame, numbers, plain, short, shown
from stlbench.report.statistics.across import Estimate
from stlbench.report.tables.across import Aggregate, Field, aggregates


def across(field: Field, key: str, colours: Colours) -> list[Chart]:
    """The charts of one field; their keys begin with `key`."""
    found = aggregates(field)
    lowest = min(score for entry in field.entries for seeds in entry.scores for score in seeds)
    ends = [end for each in found for end in (each.middle[0], *(each.middle[1] or ()))]
    of = f"(tasks: {field.name}; budget {field.budget}, track {field.track})"
    rank: dict[str, Any] = {"title": {"text": "mean rank, 1 is the best"}, "dtick": 1}
    rank |= {"tick0": 1, "range": [0.9, len(found) + 0.1]}
    return [
        _dots(
            f"{key}-iqm",
            f"Interquartile mean {of}",
            found,
            lambda each: each.middle,
            (_scores(min(ends), max(ends)), place),
            colours,
        ),
        _dots(f"{key}-rank", f"Rank {of}", found, lambda each: each.rank, (rank, float), colours),
        _profiles(f"{key}-profile", f"Performance profile {of}", field, _scores(lowest), colours),
    ]


def _scores(*ends: float) -> dict[str, Any]:
    """An axis of scores that covers these."""
    places, texts = zip(*ticks(*ends), strict=True)
    title = "<br>".join(["score", *(line.replace(", ", "<br>") for line in SCALE)])
    axis: dict[str, Any] = {"title": {"text": title}, "tickvals": numbers(places), "ticktext": list(texts)}
    return axis | {"range": [places[0] - 0.05, places[-1] + 0.05]}


_Scale = tuple[dict[str, Any], Callable[[float], float]]
"""The axis, and where a value stands on it."""


def _dots(
    key: str,
    title: str,
    found: Sequence[Aggregate],
    estimate: Callable[[Aggregate], Estimate],
    scale: _Scale,
    colours: Colours,
) -> Chart:
    """A point and its interval for each method."""
    axis, at = scale
    data = [_dot(row, each.entry.method, estimate(each), at, colours) for row, each in enumerate(found)]
    names = [short(each.entry.method) for each in found]
    rows = {"tickvals": list(range(len(found))), "ticktext": names, "range": [len(found) - 0.5, -0.5]}
    label = f"{title}: {len(found)} methods with 95 % intervals; the table of aggregates has the numbers"
    return Chart(key, title, label, data, frame(axis, rows), 100 + 34 * len(found))


def _dot(row: int, method: str, estimate: Estimate, at: Callable[[float], float], colours: Colours) -> Trace:
    (value, ends), of = estimate, colour(colours[method])
    said = f"{value:.4g}" + (f" [{ends.low:.4g}, {ends.high:.4g}]" if ends else "")
    dot: Trace = {
        **{"type": "scatter", "mode": "markers", "x": numbers([at(value)]), "y": [row], "text": [said]},
        **{"marker": {"color": of, "size": 11, "symbol": "diamond"}, "name": plain(method)},
        "hovertemplate": "%{text}<extra>%{fullData.name}</extra>",
    }
    if ends is not None:
        high, low = numbers([at(ends.high) - at(value), at(value) - at(ends.low)])
        dot["error_x"] = {"type": "data", "symmetric": False, "array": [high], "arrayminus": [low]}
        dot["error_x"] |= {"color": of, "thickness": 2, "width": 0}
    return dot


def _profiles(key: str, title: str, field: Field, scores: dict[str, Any], colours: Colours) -> Chart:
    """For each score the share of runs above it."""
    places, lines = profiles(field)
    data, own = list[Trace](), [colours[entry.method] for entry in field.entries]
    drawn = lines_of(own)
    for row, (entry, shares) in enumerate(zip(field.entries, lines, strict=True)):
        of, style = colour(own[row]), dash(drawn[row])
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
        *(shown(str(row), entry.method, colour(own[row]), drawn[row]) for row, entry in enumerate(field.entries)),
        shown("", "shaded: 95 % interval", MUTED, "box"),
    ]
    label = f"{title}: share of runs above each score, {len(lines)} methods with 95 % bands"
    return Chart(key, title, label, data, frame(scores, share), 360, legend)
