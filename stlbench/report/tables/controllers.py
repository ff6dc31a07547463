"""What the policies of each task are compared with: its controller, the baselines, the best known and its bound."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from stlbench.records.result import LEARNED, Score
from stlbench.report.tables.table import Column, Table, Value

if TYPE_CHECKING:
    from stlbench.rollout.standards import Standard


def controllers_table(standards: Mapping[str, Standard]) -> Table:
    """How well the controllers by hand and the baselines satisfy the formula, and what is best known.

    One row per task of which any of it is known.
    """
    known = {task: each for task, each in standards.items() if any(there(each) for there, *_ in _PARTS)}
    parts = [part for part in _PARTS if any(part[0](each) for each in known.values())]
    columns = (Column("task", right=False, shared=True), *(column for _, several, _, _ in parts for column in several))
    rows = tuple((task, *(value for *_, values, _ in parts for value in values(each))) for task, each in known.items())
    return Table("Controllers and baselines", columns, rows, tuple(note for *_, note in parts if note))


def _score(score: Score | None) -> tuple[Value, ...]:
    return (None, None) if score is None else (score.mean, 100 * score.satisfaction)


def _by_hand(standard: Standard) -> tuple[Value, ...]:
    score = standard.by_hand
    return (None, None, None) if score is None else (score.mean, score.minimum, 100 * score.satisfaction)


def _best(standard: Standard) -> tuple[Value, ...]:
    best = standard.best_known
    return (None, None) if best is None else (best.robustness, best.upper_bound)


def _columns(title: str, short: str) -> tuple[Column, ...]:
    return Column(title, short, digits=3), Column(f"{title} satisfied", f"{short} sat.", unit="%", digits=1, drop=1)


_Part = tuple[Callable[["Standard"], object], tuple[Column, ...], Callable[["Standard"], tuple[Value, ...]], str]
"""What must be known of some task; the columns; their values; a note."""

_PARTS: tuple[_Part, ...] = (
    (
        lambda each: each.by_hand,
        (
            Column("mean robustness", "mean", digits=3),
            Column("worst start", digits=3, drop=2),
            Column("satisfied", unit="%", digits=1),
        ),
        _by_hand,
        "First what a controller written by hand gets, from the report's starts: a reference and no upper bound.",
    ),
    (lambda each: each.zero, _columns("zero action", "zero"), lambda each: _score(each.zero), ""),
    (
        lambda each: each.constant,
        _columns("best constant action", "constant"),
        lambda each: _score(each.constant),
        "Zero action, best constant action: taken all the time. The best was chosen from other starts.",
    ),
    (
        lambda each: each.at_random,
        _columns("at random", "random"),
        lambda each: _score(each.at_random),
        "At random: actions drawn evenly from all, anew at each decision.",
    ),
    (
        lambda each: each.best_known,
        (Column("best known", digits=3), Column("upper bound", digits=3)),
        _best,
        "Best known: the most that anything reached. Upper bound: more is proven to be impossible.",
    ),
    (
        lambda each: each.trivial,
        (Column("trivial", right=False),),
        lambda each: ("trivial" if each.trivial else None,),
        f"Trivial: a constant action satisfies the formula from at least {100 * LEARNED:.0f} % of the starts. The task "
        "shows how a method holds what it has, and does not show that it learns anything.",
    ),
)
