"""All tasks and methods at a glance: on how many seeds each method learned each task."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from stlbench.report.figures import layout
from stlbench.report.figures.style import now, styled
from stlbench.report.tables.rows import Group

_ROW, _AROUND = 0.15, 1.25
"""Inches: of a row, and around all rows."""
_PALE, _DARK, _MAP = "0.99", "0.1", "Blues"
_UNKNOWN = "·"


@styled
def overview(rows: Sequence[tuple[str, Sequence[Group]]], methods: Sequence[str]) -> Figure:
    """Draw one row for each task, or for each setting of one, and one column for each method.

    An entry has the number of seeds that learned, and their share as its colour.

    Args:
        rows: name of the task or setting -> its groups, one a method.
        methods: the columns.
    """
    figure = layout.figure_of(_AROUND + _ROW * len(rows))
    axes = figure.subplots()
    shares = np.full((len(rows), len(methods)), np.nan)
    for row, (_, groups) in enumerate(rows):
        for group in groups:
            place = methods.index(str(group.setting.method))
            learned = sum(group.values("learned"))
            if group.done:
                shares[row, place] = learned / group.tried
            text = f"{learned:g}" if group.done else _UNKNOWN
            colour = _PALE if shares[row, place] > 0.6 else _DARK
            axes.text(place, row, text, ha="center", va="center", color=colour, fontsize=now().tiny)
    axes.imshow(shares, cmap=_MAP, vmin=0, vmax=1.1, aspect="auto")
    axes.set_xticks(range(len(methods)), methods, rotation=45, ha="left", rotation_mode="anchor", fontsize=now().tiny)
    axes.set_yticks(range(len(rows)), [name for name, _ in rows], fontsize=now().tiny)
    axes.tick_params(length=0, labeltop=True, labelbottom=False)
    for side in axes.spines.values():
        side.set_visible(False)
    seeds = {group.tried for _, groups in rows for group in groups if group.done}
    each = f"{min(seeds)}" if len(seeds) == 1 else f"{min(seeds)} to {max(seeds)}" if seeds else "no"
    keys: list[Artist] = [layout.patch("#08519c", f"seeds that learned the task, of {each}; the colour is their share")]
    if any(not group.done for _, groups in rows for group in groups):
        keys.append(layout.key_of(f"{_UNKNOWN} no seed finished", linestyle=""))
    return layout.finish(figure, "What each method learned", keys, 1)
