"""The style of all figures: fonts, widths of columns, lines. Sizes are those of print, as a paper takes them."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import matplotlib as mpl

__all__ = ["DOUBLE", "RC", "SINGLE", "SMALL", "TINY", "styled"]

SINGLE, DOUBLE = 3.5, 7.16
"""Inches: the width of one column and of two, in journals and proceedings of IEEE."""
SMALL, TINY = 7.0, 6.0
"""Points: of ticks and legends, and of what would not fit in these."""
RC: dict[Any, Any] = {
    "font.family": ["DejaVu Sans"],  # comes with matplotlib, so that figures are the same on every machine
    "font.size": 8,
    "figure.titlesize": 9,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "xtick.labelsize": SMALL,
    "ytick.labelsize": SMALL,
    "legend.fontsize": SMALL,
    "legend.frameon": False,
    "axes.linewidth": 0.6,
    "axes.unicode_minus": False,  # so that a number can be copied
    "axes.titlepad": 4,
    "grid.linewidth": 0.4,
    "hatch.linewidth": 0.5,
    "lines.linewidth": 1.2,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "svg.fonttype": "none",  # text stays text: it can be searched and edited
    "svg.hashsalt": "stlbench",
    "pdf.fonttype": 42,
}
Words = ParamSpec("Words")
Drawn = TypeVar("Drawn")


def styled(draw: Callable[Words, Drawn]) -> Callable[Words, Drawn]:
    """Make what a function draws look so; matplotlib reads most of it when an artist is made."""

    @wraps(draw)
    def drawing(*args: Words.args, **words: Words.kwargs) -> Drawn:
        with mpl.rc_context(RC):
            return draw(*args, **words)

    return drawing
