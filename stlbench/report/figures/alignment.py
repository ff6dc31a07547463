"""Alignment: the best possible robustness, that of the best policy by each reward, and what was learned with it."""

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
from stlbench.report.figures.palette import COLOURS
from stlbench.report.figures.scale import linear_threshold, set_symlog
from stlbench.report.tables.alignment import Aligned

__all__ = ["alignment"]

_WIDTH, _ROW, _AROUND = 7.2, 0.2, 1.1
"""Inches: of a panel, of a row, and of what stands above and below the rows."""
_COLUMNS = 2
BEST = COLOURS[2]
_MARKS: tuple[dict[str, Any], ...] = (
    {"marker": "x", "color": "0.5", "markersize": 5},
    {"marker": "o", "color": COLOURS[0], "markersize": 5},
    {"marker": "D", "color": COLOURS[1], "markersize": 7, "markerfacecolor": "none", "markeredgewidth": 1.6},
)
"""Of final and selected policies that were learned, and around them of the one that is best by the reward."""


def alignment(rows: Sequence[Aligned], units: Mapping[str, str]) -> Figure:
    """One panel per task, in it one row for each method and setting.

    Args:
        rows: of which every one has a `reward_optimal`, those of a task beside each other.
        units: of the robustness, by task.
    """
    panels = [(task, list(members)) for task, members in groupby(rows, key=lambda row: row.task)]
    columns = min(_COLUMNS, len(panels))
    lines = [panels[at : at + columns] for at in range(0, len(panels), columns)]
    heights = [_AROUND + _ROW * max(len(members) for _, members in line) for line in lines]
    figure = Figure(figsize=(_WIDTH * columns, sum(heights) + 0.9), layout="constrained")
    grid = figure.add_gridspec(len(lines), columns, height_ratios=heights)
    for i, (task, members) in enumerate(panels):
        _panel(figure.add_subplot(grid[i // columns, i % columns]), task, members, units[task])
    layout.title(figure, "Alignment: the best possible, the best by the reward, the learned")
    figure.legend(handles=_keys(), loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def _panel(axes: Axes, task: str, rows: Sequence[Aligned], unit: str) -> None:
    for i, method in enumerate(dict.fromkeys(row.method for row in rows)):
        places = [place for place, row in enumerate(rows) if row.method == method]
        if i % 2:
            axes.axhspan(places[0] - 0.5, places[-1] + 0.5, color="0.95", zorder=0)
    for place, row in enumerate(rows):
        _marks(axes, place, row)
    axes.axvline(0, color=layout.LEVEL, linewidth=0.9, zorder=1)
    axes.set_yticks(range(len(rows)), [f"{row.method}, {row.setting}" for row in rows], fontsize=8)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.grid(axis="x", alpha=0.3)
    axes.set_title(task, fontsize=10)
    axes.set_xlabel(f"mean robustness over the report starts [{unit}]{_scale(axes, rows)}", fontsize=8)
    axes.tick_params(axis="x", labelsize=8)


def _scale(axes: Axes, rows: Sequence[Aligned]) -> str:
    """Where values lie far below what is possible, the axis is logarithmic there; what its label should add.

    What is possible is in the linear part, so that nothing presses the values near it together.
    """
    values = [value for row in rows for value in _values(row)]
    possible = [row.best_possible for row in rows if row.best_possible]
    threshold = linear_threshold([possible or values], max(map(abs, values), default=0.0))
    if threshold is None:
        return ""
    return f"\n{set_symlog(axes, 'x', threshold, min(values), max(values))}"


def _values(row: Aligned) -> Iterator[float]:
    values = (row.best_possible, row.reward_optimal, row.selected, row.final)
    return (value for value in values if value is not None and math.isfinite(value))


def _marks(axes: Axes, place: int, row: Aligned) -> None:
    ends = [value for value in (row.best_possible, row.reward_optimal, row.selected) if value is not None]
    axes.plot((min(ends), max(ends)), (place, place), "-", color="0.8", linewidth=1, zorder=2)
    if row.best_possible is not None:
        upright = (place - 0.5, place + 0.5)
        axes.plot((row.best_possible,) * 2, upright, "-", color=BEST, linewidth=2.5, solid_capstyle="butt", zorder=3)
    for value, mark in zip((row.final, row.selected, row.reward_optimal), _MARKS, strict=True):
        if value is not None:
            axes.plot([value], [place], linestyle="", zorder=4, clip_on=False, **mark)


def _keys() -> list[Artist]:
    texts = ("learned: final policies", "learned: selected policies, mean over seeds", "best by the reward")
    marks = [Line2D([], [], linestyle="", label=text, **mark) for text, mark in zip(texts, _MARKS, strict=True)]
    best = Line2D([], [], color=BEST, linewidth=2.5, label="the best possible")
    return [best, *reversed(marks), layout.level_key("0: satisfied above")]
