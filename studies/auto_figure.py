"""Seeds that learn, and robustness, by rules and by hand, from results/auto and results/reference.

python studies/auto_figure.py       draw docs/figures/auto.svg
"""

from __future__ import annotations

from pathlib import Path

import recorded
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from stlbench.report.figures.style import COLOURS
from stlbench.statistics.intervals import median, median_interval

FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "auto.svg"
SHOWN = ("funnel", "raw")
HOW = {"auto": ("auto", "by rules", "o"), "shared": ("reference", "by hand", "|")}
"""Track -> the folder of its results, its name here, and its marker."""
_LEFT = 0.7
"""The least score that is shown; an arrow stands for less."""


def draw() -> Figure:
    """One row per task and method; robustness from 0 at random to 1 at the best known, with the interval of its median.

    Beside it the seeds of ten whose selected and final policies learned the task, by rules and by hand.
    """
    found = {track: recorded.recorded(folder, track) for track, (folder, _, _) in HOW.items()}
    rows = [(task, method, agent) for task, method, agent in sorted(found["auto"]) if method in SHOWN]
    rows = [row for row in rows if row in found["shared"]]
    figure = Figure(figsize=(9.0, 0.9 + 0.24 * len(rows)), layout="constrained")
    axes = figure.subplots()
    for height, row in enumerate(rows):
        texts = []
        for track, (_, _, marker) in HOW.items():
            seeds = found[track][row]
            values = [recorded.scored(row[0], value) for value in seeds.robustness]
            centre, ends = median(values), median_interval(values)
            colour = COLOURS[SHOWN.index(row[1])]
            place = height + (0.12 if track == "shared" else -0.12)
            if ends is not None:
                axes.plot([max(ends.low, _LEFT), max(ends.high, _LEFT)], [place] * 2, "-", color=colour, linewidth=1.2)
            axes.plot([max(centre, _LEFT)], [place], marker if centre > _LEFT else "<", color=colour, markersize=5)
            texts.append("{}, {}".format(*seeds.learned))
        axes.text(1.045, height, "   by hand ".join(texts), va="center", fontsize=7)
    axes.axvline(1, color="0.6", linewidth=0.8)
    axes.set(
        xlim=(_LEFT - 0.01, 1.14), ylim=(len(rows) - 0.5, -0.5), xlabel="robustness, 0 at random, 1 the best known"
    )
    axes.set_yticks(range(len(rows)), [f"{task}, {method}" for task, method, _ in rows], fontsize=7)
    axes.set_title("learned, of 10 seeds", fontsize=8, loc="right")
    axes.grid(axis="x", alpha=0.25)
    keys = [Line2D([], [], color="0.3", marker=marker, linestyle="", label=name) for _, name, marker in HOW.values()]
    figure.legend(handles=keys, loc="outside lower center", ncols=2, frameon=False, fontsize=8)
    return figure


if __name__ == "__main__":
    draw().savefig(FIGURE, metadata={"Date": None})
    print(FIGURE)
