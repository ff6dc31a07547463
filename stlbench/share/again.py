"""The score of a stored policy, once more."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from stlbench.records.identity import CellId
from stlbench.records.result import Result, Score
from stlbench.records.saved_policies import Which
from stlbench.registry.choices import Choice
from stlbench.rollout.questions import Question, plugins_of
from stlbench.rollout.referee import Referee
from stlbench.study.policies import load_policy
from stlbench.task import Task, load_task


class Again(NamedTuple):
    """What the referee says of a stored policy now."""

    cell: CellId
    scores: Mapping[str, Score]
    as_recorded: bool | None
    """Whether that is what it said when the cell was trained, exactly; None on another task."""

    @property
    def said(self) -> str:
        """In words."""
        words = {True: "as recorded", False: "not as recorded", None: "another task than its own"}
        return words[self.as_recorded]


def score_question(task: Choice, result: Result, folder: Path, which: Which) -> Question[Again]:
    """Asks for `score_again` on the task with this name."""
    plugins = ("tasks", task.name), *plugins_of(result.id)
    return Question(_on, (task, result, folder, which), plugins, f"{result.id.name} cannot be scored on {task}")


def _on(task: Choice, result: Result, folder: Path, which: Which) -> Again:
    return score_again(load_task(task), result, folder, which)


def score_again(task: Task, result: Result, folder: Path, which: Which) -> Again:
    """Score a cell's policy on its own task, or on another with the same observation and actions.

    Args:
        task: where.
        result: of the cell.
        folder: of results, where its policy is stored.
        which: of its policies.

    Raises:
        UsageError: no policy of it can be used on the task, or the task shows other things than its own.
    """
    own = task.choice == result.id.task
    kept = load_policy(folder, result, which, on=None if own else task)
    starts = kept.task.file.budgets[result.id.budget].random_starts if result.id.budget in kept.task.file.budgets else 0
    scores = Referee(kept.task, kept.method, starts).assess(kept.policy).scores
    if not own:
        return Again(result.id, scores, None)
    assert result.measurement is not None
    recorded = result.measurement.selected if which == "selected" else result.measurement.final
    return Again(result.id, scores, scores == recorded)
