"""Figures of a run: robustness by method, and learning curves, one of each a task, as PNG and SVG."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import EngFormatter
from numpy.typing import NDArray

from stlbench.errors import UsageError
from stlbench.report.rows import CurveRow, Group
from stlbench.statistics import interval, iqm

__all__ = ["draw", "learning_curves", "robustness_by_method"]

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's palette without its yellow, which is hard to see on white; told apart by colour-blind readers."""
LINES = ("-", "--", ":")
MOST = len(COLOURS) * len(LINES)
"""Groups a figure."""

Matrix = NDArray[np.float64]


class Style(NamedTuple):
    """How one group looks in every figure of its task."""

    label: str
    colour: str
    line: str


def draw(groups: Sequence[Group], folder: Path) -> list[Path]:
    """Draw both figures of each task that has a finished cell; the files' paths.

    Where a task has more groups than can be told apart, further figures have names that end in _2, _3, ...
    """
    paths = []
    for task, members in groupby(groups, key=lambda group: group.task):
        shown = list(members)
        if any(group.done for group in shown):
            for start in range(0, len(shown), MOST):
                name = _file_name(task) + (f"_{start // MOST + 1}" if start else "")
                page = shown[start : start + MOST]
                paths += _save(robustness_by_method(page), folder, f"robustness-{name}")
                paths += _save(learning_curves(page), folder, f"learning-{name}")
    return paths


def robustness_by_method(groups: Sequence[Group]) -> Figure:
    """A point a seed, the interquartile mean with its interval under it; groups of one task."""
    figure = Figure(figsize=(8.0, 1.7 + 0.6 * len(groups)), layout="constrained")
    axes: Axes = figure.subplots()
    styles = _styles(groups)
    for place, (group, style) in enumerate(zip(groups, styles, strict=True)):
        _points(axes, place, group.values(lambda numbers: numbers.robustness_mean), style)
    axes.axvline(0, color="0.5", linewidth=0.8, zorder=0)
    axes.set_yticks(range(len(groups)), [style.label.replace(" (", "\n(") for style in styles])
    axes.set_ylim(len(groups) - 0.5, -0.5)
    axes.set_xlabel("mean robustness over the report starts [unit of the predicates]")
    axes.set_title(f"{groups[0].task}: robustness by method", loc="left")
    axes.grid(axis="x", alpha=0.3)
    _key_of_points(figure)
    return figure


def _points(axes: Axes, place: int, values: Sequence[float], style: Style) -> None:
    if not values:
        where = axes.get_yaxis_transform()
        axes.text(0.5, place, "no result", transform=where, ha="center", va="center", color="0.4", backgroundcolor="w")
        return
    axes.plot(values, np.full(len(values), place - 0.12), "o", color=style.colour, alpha=0.6, markersize=6, mew=0)
    centre, ends = float(iqm(values)), interval(values, iqm)
    if ends is not None:
        axes.plot(ends, (place + 0.15, place + 0.15), "-", color=style.colour, linewidth=2.5, solid_capstyle="butt")
    axes.plot([centre], [place + 0.15], "D", color=style.colour, markersize=7, markeredgecolor="white")


def _key_of_points(figure: Figure) -> None:
    marks = [
        Line2D([], [], color="0.3", marker="o", linestyle="", alpha=0.6, label="one seed"),
        Line2D([], [], color="0.3", marker="D", linewidth=2.5, label="IQM and 95 % bootstrap interval over seeds"),
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=2, frameon=False)


def learning_curves(groups: Sequence[Group]) -> Figure:
    """Satisfaction and mean robustness on the selection starts against environment steps; groups of one task."""
    figure = Figure(figsize=(10.0, 4.2 + 0.22 * math.ceil(len(groups) / 3)), layout="constrained")
    left, right = figure.subplots(1, 2)
    for group, style in zip(groups, _styles(groups), strict=True):
        curves = [numbers.curve for numbers in group.done if numbers.curve]
        if curves:
            _band(left, curves, style, lambda point: 100 * point[1])
            _band(right, curves, style, lambda point: point[2])
    left.set(ylabel="starts that satisfy [%]", ylim=(-4, 104))
    right.set_ylabel("mean robustness [unit of the predicates]")
    right.axhline(0, color="0.5", linewidth=0.8, zorder=0)
    for axes in (left, right):
        axes.set_xlabel("environment steps")
        axes.xaxis.set_major_formatter(EngFormatter(sep=""))
        axes.grid(alpha=0.3)
    figure.suptitle(f"{groups[0].task}: learning curves on the selection starts (median, min to max over seeds)")
    _key_of_lines(figure, left)
    return figure


def _band(axes: Axes, curves: Sequence[Sequence[CurveRow]], style: Style, value: Callable[[CurveRow], float]) -> None:
    steps, values = aligned(curves, value)
    axes.fill_between(steps, values.min(axis=0), values.max(axis=0), color=style.colour, alpha=0.18, linewidth=0)
    axes.plot(steps, np.median(values, axis=0), style.line, color=style.colour, label=style.label, linewidth=1.8)


def aligned(curves: Sequence[Sequence[CurveRow]], value: Callable[[CurveRow], float]) -> tuple[Matrix, Matrix]:
    """Curves on common steps: (p,) and (seeds, p), where seeds took checkpoints at other steps linearly interpolated.

    The common steps end where the shortest curve does and begin where the latest one does.
    """
    begin, end = max(curve[0][0] for curve in curves), min(curve[-1][0] for curve in curves)
    steps = np.array(sorted({point[0] for curve in curves for point in curve if begin <= point[0] <= end}), dtype=float)
    values = [np.interp(steps, [point[0] for point in curve], [value(point) for point in curve]) for curve in curves]
    return steps, np.array(values)


def _key_of_lines(figure: Figure, axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower center", ncols=min(3, len(handles)), frameon=False)


def _styles(groups: Sequence[Group]) -> list[Style]:
    several = [len({getattr(group, name) for group in groups}) > 1 for name in ("agent", "budget")]
    styles = []
    for i, group in enumerate(groups):
        further = [part for part, shown in zip((group.agent, group.budget), several, strict=True) if shown]
        label = ", ".join([group.method, *further]) + f" ({group.seeds})"
        styles.append(Style(label, COLOURS[i % len(COLOURS)], LINES[i // len(COLOURS) % len(LINES)]))
    return styles


def _file_name(task: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", task):
        raise UsageError(f"a task named {task!r} cannot name a figure's file: letters, digits, '-', '_' and '.' can")
    return task


def _save(figure: Figure, folder: Path, name: str) -> list[Path]:
    folder.mkdir(parents=True, exist_ok=True)
    png, svg = folder / f"{name}.png", folder / f"{name}.svg"
    with mpl.rc_context({"svg.hashsalt": "stlbench"}):
        figure.savefig(png, dpi=120)
        figure.savefig(svg, metadata={"Date": None})
    return [png, svg]
