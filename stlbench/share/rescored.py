"""Stored policies scored again: one of a folder of results, or all of a bundle."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from stlbench.errors import UsageError
from stlbench.records.identity import CellId
from stlbench.records.result import Result, Score
from stlbench.records.saved_policies import Which
from stlbench.registry.choices import Choice
from stlbench.rollout.questions import Question, Unanswered, plugins_of
from stlbench.rollout.referee import Referee
from stlbench.share.checked import results_in, unpacked
from stlbench.study.plugin_guard import LONG, ask
from stlbench.study.policies import load_policy
from stlbench.task import load_task

MORE = 0.01
"""The share of robustness and of starts that a bundle may claim beyond the referee's score. Another processor rounds
differently, and a policy with two nearly equal actions may then take the other one."""


class Rescored(NamedTuple):
    """A cell's selected policy, as recorded and as found, by each protocol of its task."""

    cell: CellId
    recorded: Mapping[str, Score]
    found: Mapping[str, Score] | None  # None if it cannot be scored here
    why: str = ""  # the reason why it cannot

    @property
    def verdict(self) -> str:
        """In words; "claims more" if by any protocol the referee's score is less than `MORE` allows."""
        if self.found is None:
            return "not scored"
        if self.found == self.recorded:
            return "as recorded"
        found = self.found
        more = any(name not in found or _claims_more(said, found[name]) for name, said in self.recorded.items())
        return "claims more" if more else "within rounding"


def _claims_more(recorded: Score, found: Score) -> bool:
    lost = recorded.mean - found.mean
    return lost > MORE * abs(recorded.mean) or recorded.satisfaction - found.satisfaction > MORE


def rescore(path: Path) -> Iterator[Rescored]:
    """Score the selected policy of each cell of a bundle that has one, from the report's starts of its task.

    Raises `UsageError` if the file is no whole bundle; `check` names what is wrong.
    """
    with unpacked(path) as (folder, problems):
        if problems:
            raise UsageError(f"{path} is not scored: {problems[0]}")
        results = [result for result in results_in(folder) if result.measurement and result.measurement.policies]
        for some in (results[begin : begin + _TOGETHER] for begin in range(0, len(results), _TOGETHER)):
            questions = [score_question(result.id.task, result, folder, "selected") for result in some]
            for result, again in zip(some, ask(questions, LONG), strict=True):
                assert result.measurement is not None
                found, why = (None, again.reason) if isinstance(again, Unanswered) else (again, "")
                yield Rescored(result.id, result.measurement.selected, found, why)


_TOGETHER = 8
"""Cells that are scored before their scores are told: where plugins are of others, processes take seconds to start."""


def score_question(task: Choice, result: Result, folder: Path, which: Which) -> Question[Mapping[str, Score]]:
    """Asks for the scores of a cell's stored policy on its own task, or on another with the same observation and
    actions."""
    plugins = ("tasks", task.name), *plugins_of(result.id)
    return Question(score_again, (task, result, folder, which), plugins, f"{result.id.name} cannot be scored on {task}")


def score_again(choice: Choice, result: Result, folder: Path, which: Which) -> Mapping[str, Score]:
    """The answer. Raises `UsageError` if the policy cannot be used on that task."""
    kept = load_policy(folder, result, which, on=None if choice == result.id.task else load_task(choice))
    budget = kept.task.file.budgets.get(result.id.budget)
    return Referee(kept.task, kept.method, budget.random_starts if budget else 0).assess(kept.policy).scores
