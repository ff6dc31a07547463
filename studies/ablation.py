"""The worth of each part of each recipe, from results/ablation and results/reference; and of each rule of `auto`.

python studies/ablation.py          draw docs/figures/ablation.svg; studies/pages.py writes the table
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from recorded import Seeds, by_hand, number, recorded

from stlbench.report.figures.files import save_svg
from stlbench.report.figures.style import COLOURS, now, styled
from stlbench.report.tables.comparisons import MATTERS
from stlbench.statistics.differences import Difference, Pair, differences
from stlbench.statistics.intervals import median

FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "ablation.svg"

METHODS = ("funnel", "raw", "flag")
PARTS = {
    "features": "features beyond the state",
    "rewarded": "the form that is rewarded",
    "cuts": "cuts of returns",
    "ends": "early ends of episodes",
    "exploring": "exploring starts",
    "hold": "held actions",
}
"""PART -> the part of a recipe that `task[without=PART]` leaves out, in words."""
DERIVED = ("features", "rewarded", "cuts", "near", "exploring")
"""The parts that it leaves out on the track `auto`."""


@dataclass(frozen=True)
class Ablation:
    """One method on one task, without a part of its recipe and with the whole of it."""

    task: str
    method: str
    part: str
    without: Seeds
    whole: Seeds
    verdict: Difference
    """The verdict on the recipe without the part, against the whole one."""


_TRACKS = {
    "shared": ("reference", "ablation", tuple(PARTS)),
    "auto": ("auto", "auto-ablation", DERIVED),
}
"""Track -> folder of the whole recipes, folder without parts, parts."""


@cache
def ablations(track: str = "shared") -> tuple[Ablation, ...]:
    """Those that were run, in the order of the parts; verdicts after Holm's correction for all of them."""
    folder, without, parts = _TRACKS[track]
    whole, hand = recorded(folder, track), by_hand()
    found = []
    for (name, method, agent), seeds in recorded(without, track).items():
        task, _, part = name.removesuffix("]").partition("[without=")
        found.append((task, method, part, seeds, whole[task, method, agent]))
    found.sort(key=lambda each: (parts.index(each[2]), each[0], METHODS.index(each[1])))
    pairs = [
        Pair(one.robustness, other.robustness, MATTERS * abs(hand[task]), learned=(one.passed, other.passed))
        for task, _, _, one, other in found
    ]
    return tuple(Ablation(*each, verdict) for each, verdict in zip(found, differences(pairs), strict=True))


SIGNS = {"worse": " worse", "better": " better"}


def derived(parts: Sequence[str]) -> list[list[str]]:
    """Lines of the table of `auto`, for `raw`: task, all rules, then without each of some parts.

    An entry has the median robustness, the seeds that learned the task of all, and a verdict that decides.
    """
    found = {each.task: each.whole for each in ablations("auto")}
    without = {(each.task, each.part): each for each in ablations("auto")}
    return [
        [f"`{task}`", _short(whole), *(_entry(without.get((task, part))) for part in parts)]
        for task, whole in sorted(found.items())
    ]


def _entry(ablation: Ablation | None) -> str:
    return "" if ablation is None else _short(ablation.without) + SIGNS.get(str(ablation.verdict), "")


def _short(seeds: Seeds) -> str:
    return f"{number(str(median(seeds.robustness)))}, {seeds.learned[0]}/{len(seeds.robustness)}"


@styled
def draw(found: Sequence[Ablation]) -> Figure:
    """One panel per part; one line per task and method, from the satisfied starts with the whole recipe to those
    without the part, as means over seeds."""
    parts = [part for part in PARTS if any(each.part == part for each in found)]
    columns = [[each for each in found if each.part == part] for part in parts]
    heights = [len({each.task for each in column}) for column in columns]
    figure = Figure(figsize=(now().width, 0.9 + 0.27 * sum(heights) / 2 + 1.2), layout="constrained")
    for axes, part, column in zip(_panels(figure, heights), parts, columns, strict=True):
        _panel(axes, part, column)
    figure.legend(handles=_keys(), loc="outside lower center", ncols=5)
    return figure


def _panels(figure: Figure, heights: Sequence[int]) -> list[Axes]:
    """In two columns of about the same height."""
    halves = figure.subfigures(1, 2)
    first = int(np.argmin([abs(sum(heights[:k]) - sum(heights[k:])) for k in range(1, len(heights))])) + 1
    both = zip(halves, (heights[:first], heights[first:]), strict=True)
    return [axes for half, own in both for axes in half.subplots(len(own), 1, height_ratios=own, squeeze=False)[:, 0]]


def _panel(axes: Axes, part: str, column: Iterable[Ablation]) -> None:
    own = list(column)
    tasks = sorted({each.task for each in own})
    for each in own:
        place = METHODS.index(each.method)
        height, colour = tasks.index(each.task) + 0.24 * (place - 1), COLOURS[place]
        ends = [100 * float(np.mean(seeds.satisfaction)) for seeds in (each.whole, each.without)]
        axes.plot(ends, [height] * 2, "-", color=colour)
        axes.plot(ends[:1], [height], "o", color=colour, markerfacecolor="white", markersize=3.5)
        axes.plot(ends[1:], [height], "o", color=colour, markersize=3.5)
    axes.set_yticks(range(len(tasks)), tasks)
    axes.set(ylim=(len(tasks) - 0.5, -0.5), xlim=(-4, 104), xlabel="satisfied starts, mean over seeds [%]")
    axes.set_title(f"without {PARTS[part]}", loc="left")
    axes.grid(axis="x", alpha=0.3)


def _keys() -> list[Line2D]:
    lines = [Line2D([], [], color=COLOURS[place], label=method) for place, method in enumerate(METHODS)]
    whole = Line2D([], [], color="0.3", marker="o", markerfacecolor="white", linestyle="", label="the whole recipe")
    return [*lines, whole, Line2D([], [], color="0.3", marker="o", linestyle="", label="without the part")]


if __name__ == "__main__":
    save_svg(draw(ablations()), FIGURE)
    print(FIGURE)
