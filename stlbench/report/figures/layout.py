"""What all figures lay out alike: titles that fit, patches of a legend."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from matplotlib.artist import Artist
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from stlbench.report.figures.palette import INK, term_style
from stlbench.report.figures.style import small

LEVEL = INK
"""The grey of the line at robustness 0."""
REGION_ALPHA = 0.18
_LETTERS_PER_INCH = 13.5
"""Of a title, which is set in 9 points."""
_LETTER, _KEY = 0.56, 6
"""Of a legend: the width of a letter, of its height; letters beside a label that its line or patch takes."""


def title(figure: Figure, text: str) -> None:
    """The figure's title, on as many lines as its width takes."""
    width = int(_LETTERS_PER_INCH * figure.get_figwidth())
    figure.suptitle(textwrap.fill(text, width))


def legend(figure: Figure, keys: Sequence[Artist], most: int, size: float | None = None) -> None:
    """The legend below a figure, in as many columns as its width takes, at most `most`; long labels are wrapped."""
    points = size or small()
    letters = 72 * figure.get_figwidth() / (_LETTER * points)
    for key in keys:
        key.set_label(textwrap.fill(str(key.get_label()), int(letters) - _KEY))
    longest = max(len(line) for key in keys for line in str(key.get_label()).splitlines())
    columns = max(1, min(most, len(keys), int(letters / (longest + _KEY))))
    figure.legend(handles=list(keys), loc="outside lower center", ncols=columns, fontsize=points)


def level_key(label: str) -> Line2D:
    """The entry of a legend for the line at robustness 0."""
    return Line2D([], [], color=LEVEL, linewidth=0.9, label=label)


def patch(colour: str, label: str, alpha: float | None = None) -> Patch:
    """A filled box of a legend."""
    return Patch(facecolor=colour, alpha=alpha, linewidth=0, label=label)


def absent_patch(label: str) -> Patch:
    """The box of a legend for what the picture does not show."""
    return Patch(facecolor="none", edgecolor="0.6", linestyle=":", linewidth=1.0, label=label)


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
