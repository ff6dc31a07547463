"""The policies of a bundle, scored by the referee of this machine rather than believed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from stlbench.errors import UsageError
from stlbench.records.identity import CellId
from stlbench.records.result import Result, Score
from stlbench.rollout.questions import Unanswered
from stlbench.share.again import score_question
from stlbench.share.checked import results_in, unpacked
from stlbench.study.plugin_guard import LONG, ask

MORE = 0.01
"""What a bundle may claim beyond what the referee finds: share of the robustness, and of the starts. Another processor
rounds otherwise, and a policy that is torn between two actions then takes the other one now and then."""


class Rescored(NamedTuple):
    """A cell's selected policy, as recorded and as found, by each protocol of its task."""

    cell: CellId
    recorded: Mapping[str, Score]
    found: Mapping[str, Score] | None
    """None where it cannot be scored here."""
    why: str = ""
    """Why not."""

    @property
    def verdict(self) -> str:
        """In words; "claims more" where by any protocol the referee finds less than `MORE` allows."""
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

    Raises:
        UsageError: the file is no bundle, or is not what it says; `check` names what is wrong.
    """
    with unpacked(path) as (folder, problems):
        if problems:
            raise UsageError(f"{path} is not scored: {problems[0]}")
        results = [result for result in results_in(folder) if result.measurement and result.measurement.policies]
        for begin in range(0, len(results), _TOGETHER):
            yield from _score_cells(results[begin : begin + _TOGETHER], folder)


_TOGETHER = 8
"""Cells that are scored before their scores are told: where plugins are of others, processes take seconds to start."""


def score_cell(result: Result, folder: Path) -> Rescored | None:
    """The same of one cell of an unpacked bundle; None where it has no policy."""
    has_policy = result.measurement is not None and result.measurement.policies is not None
    return next(_score_cells([result], folder)) if has_policy else None


def _score_cells(results: Sequence[Result], folder: Path) -> Iterator[Rescored]:
    """The same of cells of an unpacked bundle that have a policy. Whatever that of one does, the next is scored."""
    questions = [score_question(result.id.task, result, folder, "selected") for result in results]
    for result, again in zip(results, ask(questions, LONG), strict=True):
        assert result.measurement is not None
        recorded = result.measurement.selected
        if isinstance(again, Unanswered):
            yield Rescored(result.id, recorded, None, again.reason)
        else:
            yield Rescored(result.id, recorded, again.scores)
