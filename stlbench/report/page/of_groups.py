"""Charts of the methods on one task: robustness by seed, learning, what training took."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from stlbench.report.figures.palette import Colours, GroupStyle, styles
from stlbench.report.figures.units import Scale
from stlbench.report.page.axis import Axis, axis_of
from stlbench.report.page.chart import (
    INK,
    MUTED,
    Chart,
    Trace,
    band,
    colour,
    dash,
    frame,
    numbers,
    plain,
    rounded,
    short,
    shown,
)
from stlbench.report.statistics.curves import MeanCurve, mean_curve
from stlbench.report.statistics.intervals import Interval, median, median_interval
from stlbench.report.tables.rows import Group
from stlbench.report.tables.times import seconds_interval

_LEVEL = {"type": "line", "layer": "below", "line": {"color": INK, "width": 1}}
"""The line at robustness 0."""


def _names(looks: Sequence[GroupStyle]) -> list[str]:
    return [short(style.label.partition(":")[0]) for style in looks]


def robustness(groups: Sequence[Group], unit: str, colours: Colours) -> Chart:
    """A point per seed, under it the median with its interval; one row per group."""
    looks = styles(groups, colours)
    values = [group.values(lambda numbers: numbers.robustness_mean) for group in groups]
    axis = axis_of(values, [0.0, *(value for seeds in values for value in seeds if math.isfinite(value))])
    data = [
        trace
        for place, (group, seeds, style) in enumerate(zip(groups, values, looks, strict=True))
        if seeds
        for trace in _of_group(place, group, seeds, style, axis)
    ]
    rows = {"tickvals": list(range(len(groups))), "ticktext": _names(looks), "range": [len(groups) - 0.5, -0.5]}
    layout = frame(axis.layout(f"mean robustness [{plain(unit)}]<br>over the report starts"), rows)
    layout["shapes"] = [_LEVEL | {"x0": 0, "x1": 0, "yref": "paper", "y0": 0, "y1": 1}]
    label = f"Robustness by seed of {len(groups)} methods; the table above has the numbers"
    legend = [shown("", "one seed", INK, "o"), shown("", "median seed, 95 % interval", INK, "d")]
    return Chart("robustness", "Robustness by seed", label, data, layout, 110 + 38 * len(groups), legend)


def _of_group(place: int, group: Group, seeds: Sequence[float], style: GroupStyle, axis: Axis) -> list[Trace]:
    kept = [row.id.seed for row in group.rows if row.numbers is not None]
    name, ends, centre = plain(style.label), median_interval(seeds), median(seeds)
    texts = [f"seed {seed}: {value:.4g}" for seed, value in zip(kept, seeds, strict=True)]
    points = _points(numbers(map(axis.at, seeds)), place - 0.15, texts, colour(style.colour), name)
    middle = _points([axis.at(centre)], place + 0.18, [_said(centre, ends)], colour(style.colour), name)
    middle["marker"] |= {"symbol": "diamond", "size": 11, "opacity": 1}
    if ends is None:
        return [points, middle]
    at, low, high = axis.at(centre), axis.at(ends.low), axis.at(ends.high)
    middle["error_x"] = {"type": "data", "symmetric": False, "array": [high - at], "arrayminus": [at - low]}
    middle["error_x"] |= {"color": colour(style.colour), "thickness": 2, "width": 0}
    return [points, middle]


def _points(x: Sequence[float | None], y: float, texts: Sequence[str], of: str, name: str) -> Trace:
    marker = {"color": of, "size": 8, "opacity": 0.8}
    template = "%{text}<extra>%{fullData.name}</extra>"
    return {
        **{"type": "scatter", "mode": "markers", "x": list(x), "y": [y] * len(x), "text": list(texts)},
        **{"marker": marker, "name": name, "hovertemplate": template},
    }


def _said(centre: float, ends: Interval | None) -> str:
    return f"median {centre:.4g}" + (f", 95 % interval [{ends.low:.4g}, {ends.high:.4g}]" if ends else "")


def learning(groups: Sequence[Group], scale: Scale, colours: Colours) -> list[Chart]:
    """Satisfaction and mean robustness of the checkpoints, two charts of each track; none without any checkpoint."""
    tracks = dict.fromkeys(group.setting.track for group in groups)
    return [
        chart
        for track in tracks
        for chart in _of_track([group for group in groups if group.setting.track == track], scale, colours, len(tracks))
    ]


def _of_track(groups: Sequence[Group], scale: Scale, colours: Colours, tracks: int) -> list[Chart]:
    """The mean over seeds and its interval."""
    looks, lines = styles(groups, colours), dict[int, tuple[MeanCurve, MeanCurve]]()
    for i, group in enumerate(groups):
        curves = [each.curve for each in group.done if each.curve]
        if curves:
            lines[i] = (
                mean_curve(curves, lambda point: 100 * point[1], (0, 100)),
                mean_curve(curves, lambda point: point[2], (-math.inf, scale.most)),
            )
    if not lines:
        return []
    legend = [
        *(
            shown(str(i), each.label, colour(each.colour), each.line if i in lines else "x")
            for i, each in enumerate(looks)
        ),
        shown("", "shaded: 95 % interval of the mean, cut at what is possible", MUTED, "box"),
    ]
    track = groups[0].setting.track
    said = f", track {track}" if tracks > 1 else ""
    end = "" if track == "shared" else f"-{track}"
    return [
        _learning(
            f"learning-satisfaction{end}", f"satisfaction{said}", "starts that satisfy [%]", (lines, looks), 0, legend
        ),
        _learning(
            f"learning-robustness{end}",
            f"robustness{said}",
            f"mean robustness [{plain(scale.unit)}]",
            (lines, looks),
            1,
            legend,
        ),
    ]


_Lines = tuple[dict[int, tuple[MeanCurve, MeanCurve]], Sequence[GroupStyle]]


def _learning(key: str, what: str, title: str, drawn: _Lines, which: int, legend: list[dict[str, str]]) -> Chart:
    lines, looks = drawn
    curves = {i: both[which] for i, both in lines.items()}
    axis = Axis(None, 0, 100) if which == 0 else _axis(list(curves.values()))
    data = [trace for i, curve in curves.items() for trace in _line(i, curve, looks[i], axis)]
    layout = frame({"title": {"text": "environment steps"}, "tickformat": "~s"}, axis.layout(title))
    if which:
        layout["shapes"] = [_LEVEL | {"y0": 0, "y1": 0, "xref": "paper", "x0": 0, "x1": 1}]
    name = f"Learning: {what}"
    label = f"{name} of {len(curves)} methods against environment steps, on the selection starts, mean over seeds"
    return Chart(key, name, f"{label}, with 95 % intervals", data, layout, 340, legend)


def _axis(curves: Sequence[MeanCurve]) -> Axis:
    """With room for what seeds had, as in the figures: the second half of each line chooses the linear part."""
    ends = [end for curve in curves for end in (curve.least, curve.most)]
    return axis_of([curve.mean[len(curve.mean) // 2 :] for curve in curves], ends)


def _line(i: int, curve: MeanCurve, style: GroupStyle, axis: Axis) -> list[Trace]:
    of, known = colour(style.colour), np.isfinite(curve.low)
    at = [*map(axis.at, curve.mean.tolist())]
    line = {
        **{"type": "scatter", "mode": "lines" if len(at) > 1 else "markers", "x": numbers(curve.steps)},
        **{"y": numbers(at), "text": [f"{value:.4g}" for value in curve.mean], "name": plain(style.label)},
        **{"line": {"color": of, "width": 2, "dash": dash(style.line)}, "legendgroup": str(i)},
        "hovertemplate": "%{x:~s} steps: %{text}<extra>%{fullData.name}</extra>",
    }
    if not known.any():
        return [line]
    low, high = ([*map(axis.at, ends[known].tolist())] for ends in (curve.low, curve.high))
    return [band(curve.steps[known].tolist(), low, high, of, legendgroup=str(i)), line]


def cost(groups: Sequence[Group], colours: Colours) -> Chart | None:
    """What training took; None where nothing finished."""
    looks, data = styles(groups, colours), list[Trace]()
    for i, (group, style) in enumerate(zip(groups, looks, strict=True)):
        if seconds := group.values(lambda numbers: numbers.training_cpu_seconds):
            data.append(_bar(i, float(np.mean(seconds)), seconds_interval(seconds), style))
    if not data:
        return None
    rows = {"tickvals": list(range(len(groups))), "ticktext": _names(looks), "range": [len(groups) - 0.5, -0.5]}
    layout = frame({"title": {"text": "training CPU [s], mean over seeds"}, "rangemode": "tozero"}, rows)
    label = f"CPU seconds of training of {len(data)} methods; the table of times has the numbers"
    return Chart("cost", "What training took", label, data, layout, 100 + 30 * len(groups))


def _bar(place: int, mean: float, ends: Interval | None, style: GroupStyle) -> Trace:
    bar: Trace = {
        **{"type": "bar", "orientation": "h", "x": [rounded(mean)], "y": [place], "width": [0.6]},
        **{"marker": {"color": colour(style.colour), "opacity": 0.8}, "name": plain(style.label)},
        "hovertemplate": "%{x:.4g} s<extra>%{fullData.name}</extra>",
    }
    if ends is not None:
        bar["error_x"] = {"type": "data", "symmetric": False, "array": [ends.high - mean]}
        bar["error_x"] |= {"arrayminus": [mean - ends.low], "color": INK, "thickness": 1.5, "width": 4}
    return bar
