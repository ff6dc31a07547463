"""The records of a committed study, setting by setting: read from the cells.csv of its folder."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from stlbench.records.result import LEARNED
from stlbench.statistics.differences import Difference
from stlbench.task import load_task

RESULTS = Path(__file__).parents[1] / "results"

Key = tuple[str, str, str]
"""Task, method, agent."""
Row = Mapping[str, str]


@dataclass(frozen=True)
class Seeds:
    """The records of one method on one task, seed by seed, with the selected policies."""

    robustness: tuple[float, ...]
    satisfaction: tuple[float, ...]
    final: tuple[float, ...]
    """Share of starts that the final policies satisfy."""

    @classmethod
    def of(cls, rows: Sequence[Row]) -> Seeds:
        """The records of finished cells."""
        names = ("robustness_mean", "satisfaction", "final_satisfaction")
        return cls(*(tuple(float(row[name]) for row in rows) for name in names))

    @property
    def passed(self) -> list[bool]:
        """Whether the selected policy of each seed learned the task."""
        return [share >= LEARNED for share in self.satisfaction]

    @property
    def mostly(self) -> bool:
        """Whether the selected policies learned the task in four of five seeds or more."""
        return sum(self.passed) >= 0.8 * len(self.passed)

    @property
    def learned(self) -> tuple[int, int]:
        """Seeds in which the selected and the final policy learned the task."""
        return sum(self.passed), sum(share >= LEARNED for share in self.final)


def verdict(row: Row) -> str:
    """The verdict of a row of comparisons: "better"; "cannot tell, 14 seeds would"."""
    return str(Difference(row["verdict"], seeds=int(row["seeds needed"]) if row["seeds needed"] else None))


def table(folder: str, name: str) -> list[Row]:
    """The rows of a table that the report wrote."""
    with (RESULTS / folder / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def cells(folder: str, track: str = "shared", budget: str = "quick") -> dict[Key, list[Row]]:
    """Those of each setting that learns, with a budget, however they ended."""
    found: dict[Key, list[Row]] = {}
    for row in table(folder, "cells"):
        if row["track"] == track and row["budget"] == budget and not row["agent"].startswith(_PLANNING):
            found.setdefault((row["task"], row["method"], row["agent"]), []).append(row)
    return found


_PLANNING = ("planner", "best-possible")


def recorded(folder: str, track: str = "shared", budget: str = "quick") -> dict[Key, Seeds]:
    """The finished seeds of each setting that learns, where there are any."""
    done = {key: [row for row in rows if row["status"] == "done"] for key, rows in cells(folder, track, budget).items()}
    return {key: Seeds.of(rows) for key, rows in done.items() if rows}


def by_hand(folder: str = "reference") -> dict[str, float]:
    """Task -> mean robustness of the controller written by hand."""
    return {row["task"]: float(row["mean robustness"]) for row in table(folder, "controllers")}


def scored(task: str, robustness: float) -> float:
    """0 for a policy that acts at random, 1 for the best known."""
    at_random, best = _ends(task)
    return (robustness - at_random) / (best - at_random)


@cache
def _ends(task: str) -> tuple[float, float]:
    file = load_task(task).file
    assert file.baselines is not None
    assert file.best_known is not None
    return file.baselines.random.robustness, file.best_known.robustness


def number(text: str, digits: int = 3) -> str:
    """Never "-0.000"."""
    shown = f"{float(text):.{digits}f}"
    return shown.lstrip("-") if float(shown) == 0 else shown


def plan_entry(row: Row | None) -> str:
    """ "0.337 (93 %)": the robustness of the best policy by a reward, and the share of starts if some violate."""
    if row is None or not row["reward_optimal"]:
        return "-"
    share = float(row["satisfied"])
    return number(row["reward_optimal"]) + (f" ({100 * share:.0f} %)" if share < 1 else "")


def first_field(rows: Sequence[Row]) -> list[Row]:
    """The first block of each budget and track in a table of aggregates: that without trivial tasks."""
    first: dict[tuple[str, str], str] = {}
    return [row for row in rows if first.setdefault((row["budget"], row["track"]), row["tasks"]) == row["tasks"]]


def markdown(header: Sequence[str], body: Iterable[Sequence[str]], right: int = 0) -> str:
    """A table; `right` columns after the first are aligned to the right."""
    rule = ["---", *["--:"] * right, *["---"] * (len(header) - 1 - right)]
    shown, *others = (f"| {' | '.join(line)} |" for line in (header, *body))
    return "\n".join((shown, f"|{'|'.join(rule)}|", *others))
