"""Alignment: the best known robustness, that of the best policy by each reward, and what was learned with it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from stlbench.report.figures import layout
from stlbench.report.figures.beyond import Window, beside, beyond_key, number, window
from stlbench.report.figures.palette import BOUNDS, INK, TRACE
from stlbench.report.figures.style import SINGLE, styled, tiny, width
from stlbench.report.tables.alignment import Aligned

_ROW, _AROUND = 0.115, 0.6
"""Inches: of a row, and of what stands above and below the rows."""
_MARKS: tuple[dict[str, Any], ...] = (
    {"marker": "x", "color": "0.6", "markersize": 3.5},
    {"marker": "o", "color": TRACE, "markersize": 3.5},
    {"marker": "D", "color": BOUNDS, "markersize": 4.5, "markerfacecolor": "none", "markeredgewidth": 1.1},
)
"""Of final and selected policies that were learned, and around them of the one that is best by the reward.

No method has these colours.
"""


@styled
def alignment(rows: Sequence[Aligned], units: Mapping[str, str]) -> Figure:
    """One panel per task, in it one row for each method and setting.

    Args:
        rows: of which every one has a `reward_optimal`, those of a task beside each other.
        units: of the robustness, by task.
    """
    panels = [(task, list(members)) for task, members in groupby(rows, key=lambda row: row.task)]
    columns = min(int(width() / SINGLE), len(panels))
    lines = [panels[at : at + columns] for at in range(0, len(panels), columns)]
    heights = [_AROUND + _ROW * max(len(members) for _, members in line) for line in lines]
    figure = Figure(figsize=(width(), sum(heights) + 0.6), layout="constrained")
    cut = False
    grid = figure.add_gridspec(len(lines), columns, height_ratios=heights)
    for i, (task, members) in enumerate(panels):
        cut = _panel(figure.add_subplot(grid[i // columns, i % columns]), task, members, units[task]) or cut
    layout.title(
        figure, "Alignment: the best known, the best by the reward, the learned (means over the report starts)"
    )
    layout.legend(figure, _keys(cut), 3)
    return figure


def _panel(axes: Axes, task: str, rows: Sequence[Aligned], unit: str) -> bool:
    """The rows of a task; whether some of their values lie below the axis."""
    for i, method in enumerate(dict.fromkeys(row.method for row in rows)):
        places = [place for place, row in enumerate(rows) if row.method == method]
        if i % 2:
            axes.axhspan(places[0] - 0.5, places[-1] + 0.5, color="0.95", zorder=0)
    shown = window([*_values(row)] for row in rows)
    for place, row in enumerate(rows):
        _marks(axes, place, row, shown)
    axes.axvline(0, color=layout.LEVEL, linewidth=0.7, zorder=1)
    axes.set_yticks(range(len(rows)), [f"{row.method}, {row.setting}" for row in rows], fontsize=tiny())
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.grid(axis="x", alpha=0.3)
    axes.set_title(task)
    axes.set_xlabel(f"mean robustness [{unit}]", fontsize=tiny())
    axes.tick_params(axis="x", labelsize=tiny())
    if shown is not None:
        axes.set_xlim(shown.limits)
    return shown is not None


def _values(row: Aligned) -> Iterator[float]:
    values = (row.best_known, row.reward_optimal, row.selected, row.final)
    return (value for value in values if value is not None and math.isfinite(value))


def _marks(axes: Axes, place: int, row: Aligned, shown: Window | None) -> None:
    ends = [value for value in (row.best_known, row.reward_optimal, row.selected) if value is not None]
    axes.plot((min(ends), max(ends)), (place, place), "-", color="0.8", linewidth=0.8, zorder=2)
    if row.best_known is not None:
        upright = (place - 0.5, place + 0.5)
        axes.plot((row.best_known,) * 2, upright, "-", color=INK, linewidth=2, solid_capstyle="butt", zorder=3)
    far = list[tuple[str, str]]()
    for value, mark in zip((row.final, row.selected, row.reward_optimal), _MARKS, strict=True):
        if value is not None and shown is not None and value < shown.low:
            far.append((number(value), mark["color"]))
        elif value is not None:
            axes.plot([value], [place], linestyle="", zorder=4, clip_on=False, **mark)
    if far:
        beside(axes, place, far)


def _keys(cut: bool) -> list[Artist]:
    texts = ("learned: final policies", "learned: selected policies, mean over seeds", "best by the reward")
    marks = [Line2D([], [], linestyle="", label=text, **mark) for text, mark in zip(texts, _MARKS, strict=True)]
    best = Line2D([], [], color=INK, linewidth=2, label="the best known")
    keys = [best, *reversed(marks), layout.level_key("0: satisfied above")]
    return [*keys, beyond_key("<", "below the axis: numbers in the colour of the mark")] if cut else [*keys]
