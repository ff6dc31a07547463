"""The measures for the policies of a task: its controller, the baselines, the best known and its bound."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from stlbench.records.identity import Setting
from stlbench.records.result import LEARNED
from stlbench.registry.choices import Choice
from stlbench.report.tables.rows import Group, maximised, trained
from stlbench.report.tables.table import Column, Table, Value

if TYPE_CHECKING:
    from stlbench.rollout.standards import Standard


@dataclass(frozen=True)
class Known:
    """The facts known of tasks without the results."""

    standards: Mapping[str, Standard] = field(default_factory=dict)
    """The scores of a task's controller and baselines, by the task's name."""
    best: Mapping[Choice, float] = field(default_factory=dict)
    """The best known robustness (`best_known`) of the formula of each task, or ablation of one."""

    def by_hand(self, task: Choice) -> float | None:
        """The mean robustness of the task's controller; an ablation has its task's controller."""
        standard = self.standards.get(task.name)
        return standard.by_hand.mean if standard and standard.by_hand else None

    def level(self, task: Choice) -> float | None:
        """The best known robustness of a task, or else its controller's."""
        return self.best.get(task, self.by_hand(task))

    def share(self, task: Choice, robustness: float | None) -> float | None:
        """Robustness as a share of the best known; None if one of them is not above 0."""
        best = self.best.get(task)
        return robustness / best if robustness is not None and best is not None and robustness > 0 < best else None

    def likeness(self, one: Setting, other: Setting) -> str | None:
        """How the methods of two settings pay the same: "=", "~", or None if they do not."""
        standard = self.standards.get(one.task.name)
        return standard.likeness(one, other) if standard else None


_Formula = tuple[str, bool]


def best_known(groups: Sequence[Group], standards: Mapping[str, Standard]) -> dict[Choice, float]:
    """Task, or ablation of one -> the best known robustness of its formula, if anybody searched for it.

    The task file states it, or a plan for the formula reached it. Plans for a reward and the controller can reach
    more. How often an agent decides changes what is possible, and other parts of a recipe do not. So ablations share
    the value, except those without `hold`.
    """
    planners, best, reached = maximised(groups), dict[_Formula, float](), dict[_Formula, float]()
    for group in trained(groups):
        value, plans = group.mean("robustness_mean"), planners.get(group.setting.agent.name)
        if value is not None and plans is not None:
            known, formula = best if plans == "formula" else reached, _formula(group.setting.task)
            known[formula] = max(value, known.get(formula, value))
    for name, standard in standards.items():
        if standard.best_known is not None:
            stated = standard.best_known.robustness
            best[name, False] = max(stated, best.get((name, False), stated))
        if standard.by_hand is not None:
            reached[name, False] = max(standard.by_hand.mean, reached.get((name, False), -math.inf))
    best = {formula: max(value, reached.get(formula, value)) for formula, value in best.items()}
    tasks = {group.setting.task for group in groups}
    return {task: best[_formula(task)] for task in tasks if _formula(task) in best}


def _formula(task: Choice) -> _Formula:
    """The choices that decide the best known: the task, and whether it is without `hold`."""
    return task.name, "hold" in dict(task.parameters).get("without", "").split("+")


_Columns = Mapping[Column, Callable[["Standard"], Value]]


def _if_known(part: str, name: str, factor: float = 1) -> Callable[[Standard], Value]:
    """A number of a part of the standard; None without the part."""

    def value(standard: Standard) -> Value:
        known = getattr(standard, part)
        number = None if known is None else getattr(known, name)
        return None if number is None else factor * number

    return value


def _baseline(part: str, title: str, short: str) -> _Columns:
    return {
        Column(title, short, digits=3): _if_known(part, "mean"),
        Column(f"{title} satisfied", f"{short} sat.", unit="%", digits=1, drop=1): _if_known(part, "satisfaction", 100),
    }


_PARTS: Mapping[str, tuple[_Columns, str]] = {
    "by_hand": (
        {
            Column("mean robustness", "mean", digits=3): _if_known("by_hand", "mean"),
            Column("worst start", digits=3, drop=2): _if_known("by_hand", "minimum"),
            Column("satisfied", unit="%", digits=1): _if_known("by_hand", "satisfaction", 100),
        },
        "First what a controller written by hand gets, from the report's starts: a reference and no upper bound.",
    ),
    "zero": (_baseline("zero", "zero action", "zero"), ""),
    "constant": (
        _baseline("constant", "best constant action", "constant"),
        "Zero action, best constant action: taken all the time. The best was chosen from other starts.",
    ),
    "at_random": (
        _baseline("at_random", "at random", "random"),
        "At random: actions drawn evenly from all, anew at each decision.",
    ),
    "best_known": (
        {
            Column("best known", digits=3): _if_known("best_known", "robustness"),
            Column("upper bound", digits=3): _if_known("best_known", "upper_bound"),
        },
        "Best known: the most that anything reached. Upper bound: more is proven to be impossible.",
    ),
    "trivial": (
        {Column("trivial", right=False): lambda each: "trivial" if each.trivial else None},
        f"Trivial: a constant action satisfies the formula from at least {100 * LEARNED:.0f} % of the starts. The task "
        "shows how a method holds what it has, and does not show that it learns anything.",
    ),
}
"""The things that some task must have: the columns that there are then, and a note."""


def controllers_table(standards: Mapping[str, Standard]) -> Table:
    """The scores of controllers and baselines, and the best known: one row for each task that has any of it."""
    known = [(task, each) for task, each in standards.items() if any(getattr(each, part) for part in _PARTS)]
    parts = [content for part, content in _PARTS.items() if any(getattr(each, part) for _, each in known)]
    columns: dict[Column, Callable[[tuple[str, Standard]], Value]] = {
        Column("task", right=False, shared=True): lambda row: row[0],
        **{
            column: lambda row, value=value: value(row[1])  # type: ignore[misc]
            for several, _ in parts
            for column, value in several.items()
        },
    }
    return Table.of("Controllers and baselines", known, columns, tuple(note for _, note in parts if note))
