"""How the traces of a story are drawn, in all of its charts."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from stlbench.contract import Array
from stlbench.report.page.chart import INK, METHOD, MUTED, Trace, numbers, shown
from stlbench.report.page.story import Pick, Story

_POINTS = 240
"""Points that a line is drawn with, about; a phone has no more."""


class Look(NamedTuple):
    colour: str
    dash: str
    line: str
    width: float


LOOKS = {
    "best": Look(METHOD, "solid", "-", 1.6),
    "median": Look(MUTED, "dash", "--", 1.6),
    "worst": Look(INK, "solid", "-", 2.2),
}


def picks_of(story: Story, *more: dict[str, str]) -> list[dict[str, str]]:
    """A legend: the picks of a story, then more."""
    return [
        *(
            shown(pick.what, f"{pick.what} start: robustness {pick.robustness:.4g}", look.colour, look.line)
            for pick in story.picks
            for look in [LOOKS[pick.what]]
        ),
        *more,
    ]


def kept(trace: Array, *steps: int) -> Array:
    """The steps that a line is drawn with: some, evenly, and these."""
    spread = np.linspace(0, len(trace) - 1, min(_POINTS, len(trace))).round()
    return np.unique(np.concatenate([spread, np.clip(steps, 0, len(trace) - 1)])).astype(np.int64)


def line_of(pick: Pick, x: Array, y: Array, **more: Any) -> Trace:
    """A line of one of the picks."""
    look = LOOKS[pick.what]
    return {
        **{"type": "scatter", "mode": "lines", "x": numbers(x), "y": numbers(y), "name": f"{pick.what} start"},
        **{"line": {"color": look.colour, "dash": look.dash, "width": look.width}, "legendgroup": pick.what},
        **more,
    }


def mark_at(places: Array, symbol: str, of: str, said: str, group: str) -> Trace:
    """A mark at each of the places (N, 2); `said` is plotly's text."""
    return {
        **{"type": "scatter", "mode": "markers", "x": numbers(places[:, 0]), "y": numbers(places[:, 1])},
        **{"marker": {"symbol": symbol, "color": of, "size": 10}, "name": said, "legendgroup": group},
        "hovertemplate": f"{said}<extra></extra>",
    }
