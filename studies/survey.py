"""Every method on each task of the survey, from results/survey and, by rules, from results/auto-survey.

python studies/survey.py            draw docs/figures/survey.svg; studies/pages.py writes the tables
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path

import yaml
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from recorded import Row, Seeds, by_hand, cells, first_field, plan_entry, recorded, table
from scipy.stats import spearmanr

from stlbench.report.figures.style import COLOURS
from stlbench.statistics.intervals import median, median_interval
from stlbench.task import load_task

STUDY = Path(__file__).parent / "survey.yaml"
FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "survey.svg"
FOLDER = "survey"
_BOTH = ((FOLDER, "shared"), ("auto-survey", "auto"))
"""Folders and tracks: by hand and by rules."""

_COLOURS = COLOURS[0], COLOURS[4], COLOURS[1]
"""Blue where every seed learned, orange where some did, red where none did."""
_PANELS_PER_ROW = 3
_FEWEST_PLANS = 3
_BELOW = 1.5
"""How far below 0 a panel goes, in units of the robustness of the controller by hand."""


@cache
def order() -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Tasks and methods, as the study names them, of which something was run."""
    study = yaml.safe_load(STUDY.read_text(encoding="utf-8"))
    run = {task for task, *_ in cells(FOLDER)}
    return tuple(task for task in study["tasks"] if task in run), tuple(study["methods"])


@cache
def results(track: str = "shared") -> dict[tuple[str, str], list[Row]]:
    """Task and method -> its cells, by the task's own agent."""
    return {(task, method): rows for (task, method, _), rows in cells(FOLDER, track).items()}


def planned() -> tuple[list[str], list[list[str]]]:
    """One line per method: the robustness of the policy that is best by its reward, and the starts that satisfy.

    Without tasks on which every such policy reaches the best known, and without methods that have few plans.
    """
    found = {
        (row["task"], row["method"]): row
        for row in table(FOLDER, "alignment")
        if row["reward_optimal"] and "gamma=1" not in row["setting"] and "[" not in row["task"]
    }
    tasks = [
        task for task in order()[0] if len({row["reward_optimal"] for row in found.values() if row["task"] == task}) > 1
    ]
    found = {key: row for key, row in found.items() if key[0] in tasks}
    best = ["*the best known*", *(f"{max(_known(task), *_reached(found, task)):.3f}" for task in tasks)]
    plans = Counter(method for _, method in found)
    methods = [method for method in order()[1] if plans[method] >= _FEWEST_PLANS]
    lines = [[f"`{method}`", *(plan_entry(found.get((task, method))) for task in tasks)] for method in methods]
    return ["best by", *(f"`{task}`" for task in tasks)], [best, *lines]


def _known(task: str) -> float:
    known = load_task(task).file.best_known
    assert known is not None
    return known.robustness


def _reached(found: Mapping[tuple[str, str], Row], task: str) -> list[float]:
    """The robustness of plans. Their starts are random, so it can be more than is known from the grid."""
    return [float(row["reward_optimal"]) for (name, _), row in found.items() if name == task]


def survived() -> str:
    """Sentences: what of the survey by hand is the same by rules."""
    hand, rules = ({key[:2]: each for key, each in recorded(*of).items()} for of in _BOTH)
    both = [(seeds.mostly, rules[key].mostly) for key, seeds in hand.items() if key in rules]
    same = sum(one == other for one, other in both)
    ranks = [{name: float(row["rank"]) for name, row in _aggregates(*of).items()} for of in _BOTH]
    correlation = spearmanr(*([each[method] for method in ranks[0]] for each in ranks)).statistic
    return (
        f"{same} of {len(both)} pairs of a method and a task are learned in both ways or in none, in four of five "
        f"seeds or more. The rank correlation of the methods (Spearman's) is {correlation:.2f}."
    )


def _aggregates(folder: str, track: str) -> dict[str, Row]:
    return {row["method"]: row for row in first_field(table(folder, "aggregates")) if row["track"] == track}


def draw() -> Figure:
    """One panel per task, one row per method: robustness, with its interval, and in how many seeds it was learned."""
    tasks, methods = order()
    rows = -(-len(tasks) // _PANELS_PER_ROW)
    figure = Figure(figsize=(10.0, 0.6 + 3.0 * rows), layout="constrained")
    panels = figure.subplots(rows, _PANELS_PER_ROW, squeeze=False, sharey=True)
    hand = by_hand(FOLDER)
    for axes, task in zip(panels.flat, tasks, strict=False):
        _panel(axes, task, methods, hand.get(task))
    for axes in panels.flat[len(tasks) :]:
        axes.set_visible(False)
    figure.legend(handles=_keys(), loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    return figure


def _panel(axes: Axes, task: str, methods: Sequence[str], hand: float | None) -> None:
    done = {
        method: Seeds.of([row for row in results().get((task, method), ()) if row["status"] == "done"])
        for method in methods
    }
    unit = hand or max(median(seeds.robustness) for seeds in done.values() if seeds.robustness)
    low = -_BELOW * unit
    for height, method in enumerate(methods):
        if not done[method].robustness:
            rows = results().get((task, method), ())
            axes.text(low, height, f" {_status(rows)}", va="center", fontsize=7, color="0.45", style="italic")
        else:
            _mark(axes, height, done[method], low)
    axes.axvline(0, color="0.6", linewidth=0.8)
    if hand is not None:
        axes.axvline(hand, color="0.2", linewidth=0.8, linestyle="--")
    axes.set(xlim=(low * 1.06, 1.25 * unit), ylim=(len(methods) - 0.5, -0.5), xlabel="robustness")
    axes.set_yticks(range(len(methods)), methods, fontsize=8)
    axes.set_title(task, fontsize=10, loc="left")
    axes.grid(axis="x", alpha=0.25)


def _status(rows: Iterable[Row]) -> str:
    return ", ".join(sorted({row["status"] for row in rows})) or "not run"


def _mark(axes: Axes, height: int, seeds: Seeds, low: float) -> None:
    """Median and interval; an arrow at the edge, with its number, where it is farther below."""
    centre, ends, colour = median(seeds.robustness), median_interval(seeds.robustness), _COLOURS[_kind(seeds)]
    if centre < low:
        axes.plot([low], [height], "<", color=colour, markersize=6)
        axes.text(low, height, f"   {centre:.3g}", va="center", fontsize=7, color="0.3")
        return
    if ends is not None:
        axes.plot([max(ends.low, low), ends.high], [height] * 2, "-", color=colour, linewidth=1.6)
    axes.plot([centre], [height], "os^"[_kind(seeds)], color=colour, markersize=5)


def _kind(seeds: Seeds) -> int:
    """0: learned in every seed, 1: in some, 2: in none."""
    selected = seeds.learned[0]
    return 0 if selected == len(seeds.robustness) else 1 if selected else 2


def _keys() -> list[Line2D]:
    texts = ("learned in every seed", "in some seeds", "in none")
    marks = [
        Line2D([], [], color=_COLOURS[kind], marker="os^"[kind], linestyle="", label=text)
        for kind, text in enumerate(texts)
    ]
    return [*marks, Line2D([], [], color="0.2", linestyle="--", linewidth=0.8, label="controller by hand")]


if __name__ == "__main__":
    draw().savefig(FIGURE, metadata={"Date": None})
    print(FIGURE)
