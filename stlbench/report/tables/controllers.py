"""What the policies of a task are compared with: its controller, the baselines, the best known and its bound."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeVar

from stlbench.records.identity import Setting
from stlbench.records.result import LEARNED, Score
from stlbench.registry.choices import Choice
from stlbench.report.tables.rows import Group, maximised, trained
from stlbench.report.tables.table import Column, Table, Value

if TYPE_CHECKING:
    from stlbench.rollout.standards import Standard
    from stlbench.task.file import BestKnown


@dataclass(frozen=True)
class Known:
    """What is known of tasks without the results."""

    standards: Mapping[str, Standard] = field(default_factory=dict)
    """By the task's name: what its controller and the baselines get."""
    best: Mapping[Choice, float] = field(default_factory=dict)
    """Of each task, or ablation of one, the best known robustness of its formula (`best_known`)."""

    def by_hand(self, task: Choice) -> float | None:
        """The mean robustness of the task's controller; an ablation has its task's controller."""
        standard = self.standards.get(task.name)
        return standard.by_hand.mean if standard and standard.by_hand else None

    def level(self, task: Choice) -> float | None:
        """The best known robustness of a task, or else its controller's."""
        return self.best.get(task, self.by_hand(task))

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
    """What decides the best known: the task, and whether it is without `hold`."""
    return task.name, "hold" in dict(task.parameters).get("without", "").split("+")


_P = TypeVar("_P")
_Columns = Mapping[Column, Callable[["Standard"], Value]]


def _if_known(part: Callable[[Standard], _P | None], value: Callable[[_P], Value]) -> Callable[[Standard], Value]:
    return lambda standard: None if (known := part(standard)) is None else value(known)


def _baseline(score: Callable[[Standard], Score | None], title: str, short: str) -> _Columns:
    return {
        Column(title, short, digits=3): _if_known(score, lambda known: known.mean),
        Column(f"{title} satisfied", f"{short} sat.", unit="%", digits=1, drop=1): (
            _if_known(score, lambda known: 100 * known.satisfaction)
        ),
    }


def _by_hand(standard: Standard) -> Score | None:
    return standard.by_hand


def _best_known(standard: Standard) -> BestKnown | None:
    return standard.best_known


_PARTS: tuple[tuple[Callable[[Standard], object], _Columns, str], ...] = (
    (
        _by_hand,
        {
            Column("mean robustness", "mean", digits=3): _if_known(_by_hand, lambda score: score.mean),
            Column("worst start", digits=3, drop=2): _if_known(_by_hand, lambda score: score.minimum),
            Column("satisfied", unit="%", digits=1): _if_known(_by_hand, lambda score: 100 * score.satisfaction),
        },
        "First what a controller written by hand gets, from the report's starts: a reference and no upper bound.",
    ),
    (lambda each: each.zero, _baseline(lambda each: each.zero, "zero action", "zero"), ""),
    (
        lambda each: each.constant,
        _baseline(lambda each: each.constant, "best constant action", "constant"),
        "Zero action, best constant action: taken all the time. The best was chosen from other starts.",
    ),
    (
        lambda each: each.at_random,
        _baseline(lambda each: each.at_random, "at random", "random"),
        "At random: actions drawn evenly from all, anew at each decision.",
    ),
    (
        _best_known,
        {
            Column("best known", digits=3): _if_known(_best_known, lambda best: best.robustness),
            Column("upper bound", digits=3): _if_known(_best_known, lambda best: best.upper_bound),
        },
        "Best known: the most that anything reached. Upper bound: more is proven to be impossible.",
    ),
    (
        lambda each: each.trivial,
        {Column("trivial", right=False): lambda each: "trivial" if each.trivial else None},
        f"Trivial: a constant action satisfies the formula from at least {100 * LEARNED:.0f} % of the starts. The task "
        "shows how a method holds what it has, and does not show that it learns anything.",
    ),
)
"""The condition that some task must meet; the columns that there are then; a note."""


def controllers_table(standards: Mapping[str, Standard]) -> Table:
    """What controllers and baselines get, and what is best known: one row for each task that has any of it."""
    known = {task: each for task, each in standards.items() if any(there(each) for there, *_ in _PARTS)}
    parts = [part for part in _PARTS if any(map(part[0], known.values()))]
    columns = (Column("task", right=False, shared=True), *(column for _, several, _ in parts for column in several))
    rows = tuple(
        (task, *(value(each) for _, several, _ in parts for value in several.values())) for task, each in known.items()
    )
    return Table("Controllers and baselines", columns, rows, tuple(note for *_, note in parts if note))
