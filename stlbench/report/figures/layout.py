"""What all figures lay out alike: titles that fit, patches of a legend."""

from __future__ import annotations

import textwrap

from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from stlbench.report.figures.palette import term_style

__all__ = ["LEVEL", "REGION_ALPHA", "level_key", "patch", "term_patch", "title"]

LEVEL = "0.15"
"""The grey of the line at robustness 0."""
REGION_ALPHA = 0.18
_LETTERS_PER_INCH = 13.5
"""Of a title, which is set in 9 points."""


def title(figure: Figure, text: str) -> None:
    """The figure's title, on as many lines as its width takes."""
    width = int(_LETTERS_PER_INCH * figure.get_figwidth())
    figure.suptitle(textwrap.fill(text, width))


def level_key(label: str) -> Line2D:
    """The entry of a legend for the line at robustness 0."""
    return Line2D([], [], color=LEVEL, linewidth=0.9, label=label)


def patch(colour: str, label: str, alpha: float | None = None) -> Patch:
    """A filled box of a legend."""
    return Patch(facecolor=colour, alpha=alpha, linewidth=0, label=label)


def term_patch(i: int, label: str) -> Patch:
    """The box of a legend for the region of term i, filled and framed as the region is."""
    style = term_style(i)
    return Patch(
        facecolor=to_rgba(style.colour, REGION_ALPHA),
        edgecolor=style.colour,
        hatch=style.hatch,
        linewidth=1.3,
        label=label,
    )
