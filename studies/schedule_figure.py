"""The windows of a schedule over time, for the page on schedules.

python studies/schedule_figure.py       draw docs/figures/schedule.svg
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

from matplotlib.figure import Figure

from stlbench.report.figures.style import COLOURS
from stlbench.task import load_task
from stlbench.tracks.auto import alternatives

FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "schedule.svg"
TASK = "suite-integrator-patrol-0"


def draw() -> Figure:
    """One row for each region of a patrol, with the windows in which it is visited."""
    task = load_task(TASK)
    schedule = alternatives(task)[0]
    regions = list(dict.fromkeys(str(term.psi) for term in schedule.terms))
    figure = Figure(figsize=(7.0, 1.9), layout="constrained")
    axes = figure.subplots()
    ends = list[tuple[float, int]]()
    for term in schedule.terms:
        row = regions.index(str(term.psi))
        width = term.end - term.start
        axes.barh(row, width, left=term.start, height=0.5, color=COLOURS[row])
        axes.annotate(
            f"{term.start}..{term.end}",
            (term.start + width / 2, row),
            (0, 14),
            textcoords="offset points",
            ha="center",
            fontsize=7,
        )
        ends.append((term.end, row))
    for (step, row), (later, other) in pairwise(ends):
        axes.annotate("", (later, other), (step, row), arrowprops={"arrowstyle": "->", "color": "0.5", "lw": 0.8})
    axes.set_yticks(range(len(regions)), [f"{'AB'[row]}: {name}" for row, name in enumerate(regions)], fontsize=7)
    axes.set(xlim=(0, task.file.steps), ylim=(len(regions) - 0.4, -0.8), xlabel="step")
    axes.spines[["top", "right"]].set_visible(False)
    return figure


if __name__ == "__main__":
    draw().savefig(FIGURE, metadata={"Date": None})
