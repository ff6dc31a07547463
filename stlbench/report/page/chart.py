"""Charts as plotly draws them, written as plain values: what the page's script is given."""

from __future__ import annotations

import html
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from stlbench.errors import one_line
from stlbench.report.figures.palette import SAFE, Line

Trace = dict[str, Any]
"""One of plotly's traces."""

METHOD = "@method"
"""Stands for the colour of the method of a story, until `in_colour` puts it in."""
INK, MUTED, MARK = "@ink", "@muted", "@mark"
"""Colours that the page's script puts in, since they differ between light and dark."""
_DASHES: dict[Line, str] = {"-": "solid", "--": "dash", ":": "dot"}
_BLACK = SAFE[-1]
_LONGEST = 30
"""Letters of a name on an axis."""


@dataclass(frozen=True)
class Chart:
    """One chart. Texts in `data` and `layout` are plotly's, in which names stand as `plain` makes them."""

    key: str
    """Which chart of its part of the page."""
    title: str
    label: str
    """What it shows, for those who cannot see it."""
    data: list[Trace]
    layout: dict[str, Any]
    height: int = 340
    """Pixels."""
    legend: list[dict[str, str]] = field(default_factory=list)
    """Its entries, from `shown`; each switches the traces of its group."""

    def content(self) -> dict[str, Any]:
        """What the script draws."""
        return {"data": self.data, "layout": self.layout, "legend": self.legend}


def in_colour(chart: Chart, of: str) -> Chart:
    """The chart with this colour for `METHOD`."""
    content = json.loads(json.dumps(chart.content()).replace(f'"{METHOD}"', f'"{of}"'))
    return replace(chart, **content)


def plain(text: object) -> str:
    """A name in plotly's texts, which take some tags for markup."""
    return html.escape(one_line(str(text)), quote=False)


def short(text: object) -> str:
    """The same on an axis, where a long name would leave no room."""
    name = one_line(str(text))
    return plain(name if len(name) <= _LONGEST else f"{name[: _LONGEST - 1]}…")


def colour(name: str) -> str:
    """A colour of the palette; black is the colour of text, which is white where the page is dark."""
    return INK if name == _BLACK else name


def dash(line: Line) -> str:
    """A style of lines by plotly's name."""
    return _DASHES[line]


def rounded(value: float | None) -> float | None:
    """With five significant digits, which no screen can tell from all of them; None where it is no finite number."""
    return None if value is None or not math.isfinite(value) else float(f"{value:.5g}")


def numbers(values: Iterable[float]) -> list[float | None]:
    """Each `rounded`."""
    return [rounded(float(value)) for value in values]


def shown(group: str, label: str, colour: str, line: str = "-") -> dict[str, str]:
    """An entry of a legend; `label` is text, not markup.

    `line` is a style of lines, "box", or a mark: "o", "d", "s", "c" (a circle) or "x".
    """
    return {"group": group, "label": one_line(label), "color": colour, "line": line}


def band(x: Sequence[float], low: Sequence[float], high: Sequence[float], colour: str, **more: Any) -> Trace:
    """A filled strip between two lines, which says nothing when it is pointed at."""
    around = [*numbers(x), *reversed(numbers(x))]
    return {
        "type": "scatter",
        "x": around,
        "y": [*numbers(low), *reversed(numbers(high))],
        "fill": "toself",
        "fillcolor": colour,
        "opacity": 0.18,
        "line": {"width": 0},
        "mode": "lines",
        "hoverinfo": "skip",
        **more,
    }


def frame(x: Mapping[str, Any] | None = None, y: Mapping[str, Any] | None = None, **more: Any) -> dict[str, Any]:
    """A layout with one pair of axes."""
    layout: dict[str, Any] = {
        "margin": {"l": 56, "r": 12, "t": 8, "b": 44},
        "showlegend": False,
        "hovermode": "closest",
        "xaxis": {"automargin": True, "zeroline": False, **(x or {})},
        "yaxis": {"automargin": True, "zeroline": False, **(y or {})},
    }
    return layout | more
