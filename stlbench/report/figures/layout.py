"""The common layout of all figures: titles and legends that fit, and axes whose values span orders of magnitude."""

import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from statistics import median
from typing import Any, NamedTuple

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import StrMethodFormatter, SymmetricalLogLocator

from stlbench.contract import Array
from stlbench.report.figures.style import INK, now, term_style

LEVEL = INK  # the grey of the line at robustness 0
REGION_ALPHA = 0.18
_LETTERS_PER_INCH = 13.5  # of a title, which is set in 9 points
_LETTER, _KEY = 0.56, 6
"""Numbers of a legend: the width of a letter, as a share of its height; letters that a line or a patch takes."""


def figure_of(height: float) -> Figure:
    """An empty figure as wide as the current format, so many inches high."""
    return Figure(figsize=(now().width, height), layout="constrained")


def finish(figure: Figure, title: str, keys: Sequence[Artist], columns: int, size: float | None = None) -> Figure:
    """Add the title, on as many lines as the width takes, and the legend below, in at most so many columns."""
    figure.suptitle(textwrap.fill(title, int(_LETTERS_PER_INCH * figure.get_figwidth())))
    points = size or now().small
    letters = 72 * figure.get_figwidth() / (_LETTER * points)
    for key in keys:
        key.set_label(textwrap.fill(str(key.get_label()), int(letters) - _KEY))
    longest = max(len(line) for key in keys for line in str(key.get_label()).splitlines())
    columns = max(1, min(columns, len(keys), int(letters / (longest + _KEY))))
    figure.legend(handles=list(keys), loc="outside lower center", ncols=columns, fontsize=points)
    return figure


def key_of(label: str, **style: Any) -> Line2D:
    return Line2D([], [], label=label, **style)


def level_key(label: str) -> Line2D:
    return key_of(label, color=LEVEL, linewidth=0.9)


def patch(colour: str, label: str, alpha: float | None = None) -> Patch:
    return Patch(facecolor=colour, alpha=alpha, linewidth=0, label=label)


def absent_patch(label: str) -> Patch:
    """The box of a legend for what the picture does not show."""
    return Patch(facecolor="none", edgecolor="0.6", linestyle=":", linewidth=1.0, label=label)


def term_patch(i: int, label: str) -> Patch:
    """The box of a legend for the region of term i, filled and framed as the region is."""
    colour, hatch = term_style(i)
    return Patch(facecolor=to_rgba(colour, REGION_ALPHA), edgecolor=colour, hatch=hatch, linewidth=1.3, label=label)


def shares_map(
    axes: Axes, shares: Array, texts: Mapping[tuple[int, int], str], rows: Sequence[str], size: float
) -> None:
    """Draw shares (rows, columns) as colours, NaN without one; texts by row and column, and the names of the rows."""
    axes.imshow(shares, cmap="Blues", vmin=0, vmax=1.1, aspect="auto")
    for (row, place), text in texts.items():
        entry = axes.text(place, row, text, ha="center", va="center", fontsize=now().tiny)
        entry.set_color("0.99" if shares[row, place] > 0.6 else "0.1")
        if "\n" in text:
            entry.set_linespacing(1.0)
    axes.set_yticks(range(len(rows)), rows, fontsize=size)
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)


_NEAR, _FAR = 5.0, 10.0
"""Times the distance of the nearest group: the first is shown, and no axis is cut up to the second."""
_LEAST, _LEAST_AT_ZERO = 1e-3, 2e-2
"""The distance of the nearest group is at least this share of the largest: one value at 0 cuts nothing off.

The second number counts if no value is positive, as when 0 is the best known.
"""
_ROOM = 0.25  # room below 0, as a share of the room above
_FROM = 0.5  # share of a lower end to the left of all arrows: on the right, curves that rise have risen
_MARGIN = 0.05
_PAPER = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.5}  # behind a number, over other marks


class Zoom(NamedTuple):
    low: float
    high: float

    @property
    def limits(self) -> tuple[float, float]:
        margin = _MARGIN * (self.high - self.low) or 1.0
        return self.low - margin, self.high + margin


def window(groups: Iterable[Iterable[float]]) -> Zoom | None:
    """The end of an axis so that values of the best groups can be told apart; None if it can show all.

    The distance of a value is from the best of all, or from 0 if none is positive. A group has that of its median. The
    axis shows 0, and values up to five times as far as the nearest group, or as the best value is above 0. It shows all
    if no value is more than ten times as far.
    """
    finite = [shown for group in groups if (shown := [value for value in group if math.isfinite(value)])]
    values = [value for group in finite for value in group]
    top = max([0.0, *values])
    furthest = top - min(values, default=0.0)
    share = _LEAST if top > 0 else _LEAST_AT_ZERO
    least = max(min((top - median(group) for group in finite), default=0.0), top, share * furthest)
    if furthest <= _FAR * least:
        return None
    return Zoom(min([-_ROOM * top, *(value for value in values if top - value <= _NEAR * least)]), top)


def number(value: float) -> str:
    """A value beyond the axis, in three digits or so."""
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:,.0f}"


def arrow_at_left(axes: Axes, place: float, texts: Sequence[tuple[str, str]]) -> None:
    """Draw an arrow at the left end of a row, and the numbers that lie there, each in its colour."""
    where, shift = axes.get_yaxis_transform(), 7.0
    axes.plot([0.0], [place], "<", color=texts[0][1], markersize=4.5, transform=where, clip_on=False, zorder=6)
    for text, colour in texts:
        words = axes.annotate(text, (0.0, place), (shift, 0), xycoords=where, textcoords="offset points")
        words.set(ha="left", va="center", color=colour, fontsize=now().tiny, bbox=_PAPER, zorder=7)
        shift += 0.62 * now().tiny * len(text) + 5


def arrows_below(axes: Axes, texts: Sequence[tuple[str, str]]) -> None:
    """Draw an arrow at the lower end of an axis for each line that ends below it, with the number in its colour."""
    where = axes.transAxes
    for i, (text, colour) in enumerate(texts):
        place = _FROM + (1 - _FROM) * (i + 1) / (len(texts) + 1)
        axes.plot([place], [0.0], "v", color=colour, markersize=4.5, transform=where, clip_on=False, zorder=6)
        words = axes.annotate(text, (place, 0.0), (0, 5), xycoords=where, textcoords="offset points", rotation=90)
        words.set(ha="center", va="bottom", color=colour, fontsize=now().tiny, bbox=_PAPER, zorder=7)


def beyond_key(marker: str, text: str) -> Line2D:
    return key_of(text, linestyle="", marker=marker, color="0.3", markersize=5)


_LINEAR_ENOUGH = 10.0  # if the largest value is at most that many times the smaller one, a linear axis shows both well
_DECADES = 4  # the logarithmic part has at most so many, so that a value near 0 does not squeeze all others
_PAD = 0.04


def linear_threshold(value: float, largest: float) -> float | None:
    """Up to which magnitude an axis has to be linear, so that values up to `value` can be told apart.

    `largest` is the largest magnitude on the axis. The threshold is 1, 2 or 5 times a power of ten, and at least a
    10,000th of `largest`. None if a linear axis will do.
    """
    reach = max(value, largest / 10**_DECADES)
    if not math.isfinite(reach) or not math.isfinite(largest) or largest <= _LINEAR_ENOUGH * reach:
        return None
    exponent = math.floor(math.log10(reach))
    return next(each for digit in (1, 2, 5, 10) if 1.01 * (each := float(f"{digit}e{exponent}")) >= reach)


def set_symlog(axes: Axes, threshold: float, low: float, high: float) -> str:
    """Make the y axis linear up to `threshold` and logarithmic beyond, over at least [low, high]; a note on it.

    Over one decade and a half or less, 2 and 5 times the powers of ten have numbers too.
    """
    low, high = min(low, -threshold) if low < 0 else 0.0, max(high, threshold) if high > 0 else 0.0
    axes.set_yscale("symlog", linthresh=threshold, subs=range(2, 10))
    numbered = (1,) if max(-low, high) > 10**1.5 * threshold else (1, 2, 5)
    ticks = SymmetricalLogLocator(base=10, linthresh=threshold, subs=numbered).tick_values(low, high)
    axes.set_yticks([tick for tick in ticks if tick == 0 or abs(tick) > 0.99 * threshold])  # nearer ones would touch
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    transform = axes.yaxis.get_transform()
    ends = transform.transform([low, high])
    pad = _PAD * (ends[1] - ends[0])
    axes.set_ylim(*transform.inverted().transform([ends[0] - pad, ends[1] + pad]))
    return f"logarithmic beyond ±{threshold:g}"
