"""The style of all figures: fonts, widths of columns, lines. Sizes are those of print, as a paper takes them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import Any, NamedTuple, ParamSpec, TypeVar

from stlbench.report.tables.table import Width

SINGLE, DOUBLE = 3.5, 7.16
"""Inches: the width of one column and of two, in journals and proceedings of IEEE."""


class Format(NamedTuple):
    """How wide figures are, and how large their text is."""

    width: float
    """Inches."""
    text: float
    """Points: of labels and titles of axes."""
    small: float
    """Of ticks and legends."""
    tiny: float
    """Of what would not fit in these."""


_FORMATS: dict[Width, Format] = {"page": Format(DOUBLE, 8, 7, 6), "column": Format(SINGLE, 8, 8, 7)}
_now: ContextVar[Format] = ContextVar("format", default=_FORMATS["page"])


@contextmanager
def fitting(wanted: Width) -> Iterator[None]:
    """What is drawn within fits a column of a paper, or the page."""
    before = _now.set(_FORMATS[wanted])
    try:
        yield
    finally:
        _now.reset(before)


def format_now() -> Format:
    """The format of what is drawn now."""
    return _now.get()


def width() -> float:
    """Inches of a figure."""
    return _now.get().width


def small() -> float:
    """Points of ticks and legends."""
    return _now.get().small


def tiny() -> float:
    """Points of what would not fit in `small`."""
    return _now.get().tiny


def rc() -> dict[Any, Any]:
    """What matplotlib is told, for the format of now."""
    sizes = _now.get()
    return {
        "font.family": ["DejaVu Sans"],  # comes with matplotlib, so that figures are the same on every machine
        "font.size": sizes.text,
        "figure.titlesize": sizes.text + 1,
        "axes.titlesize": sizes.text,
        "axes.labelsize": sizes.text,
        "xtick.labelsize": sizes.small,
        "ytick.labelsize": sizes.small,
        "legend.fontsize": sizes.small,
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
        import matplotlib as mpl

        with mpl.rc_context(rc()):
            return draw(*args, **words)

    return drawing
