"""The critical-difference diagram of Demsar (2006, JMLR 7): mean ranks over tasks, and which methods may be alike."""

from __future__ import annotations

from matplotlib.figure import Figure

from stlbench.report.figures import layout
from stlbench.report.figures.style import INK, Colours, now, styled
from stlbench.report.tables.across import Field
from stlbench.statistics.critical import ranking

_AROUND, _ROW = 1.0, 0.2
"""Inches: around the rows, and of a row."""


@styled
def ranks(field: Field, colours: Colours) -> Figure:
    """Draw the mean rank of each method, the best on top, and a bar for each set of methods that may be alike.

    All methods fit all tasks of the field.
    """
    found = ranking(field.medians)
    order = sorted(range(len(field.entries)), key=lambda method: found.ranks[method])
    sets = found.alike
    figure = layout.figure_of(_AROUND + _ROW * (len(order) + len(sets) + 1))
    axes = figure.subplots()
    for row, method in enumerate(order):
        name, rank = field.entries[method].method, found.ranks[method]
        axes.plot([1, rank], [row, row], "-", color="0.85", linewidth=0.8, zorder=1)
        axes.plot([rank], [row], "o", color=colours[name], markersize=5, zorder=3)
        axes.annotate(f"{rank:.2f}", (rank, row), (5, 0), textcoords="offset points", va="center", fontsize=now().tiny)
    for row, members in enumerate(sets, len(order)):
        ends = [found.ranks[members[0]], found.ranks[members[-1]]]
        axes.plot(ends, [row, row], "-", color=INK, linewidth=2.5, solid_capstyle="butt")
    row = len(order) + len(sets)
    axes.errorbar(1 + found.difference / 2, row, xerr=found.difference / 2, color="0.4", capsize=3, linewidth=1)
    names = [field.entries[method].method for method in order]
    axes.set_yticks(range(row + 1), [*names, *["may be alike"] * len(sets), "critical difference"])
    axes.set_ylim(row + 0.6, -0.6)
    axes.set_xlim(0.9, max(len(order), 1 + found.difference) + 0.3)
    axes.set_xticks(range(1, len(order) + 1))
    axes.set_xlabel("mean rank, 1 is the best")
    axes.grid(axis="x", alpha=0.3)
    title = f"Ranks over drawn tasks ({field.name}; budget {field.budget}, track {field.track})"
    test = f"critical difference by Nemenyi, 5 % for all pairs (Friedman's test: p = {found.chance:.2g})"
    keys = [
        layout.key_of("may be alike: no pair is farther apart than the critical difference", color=INK, linewidth=2.5),
        layout.key_of(test, color="0.4", linewidth=1),
    ]
    return layout.finish(figure, title, keys, 2)
