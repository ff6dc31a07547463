"""The policies of a bundle, scored by the referee of this machine rather than believed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from stlbench.contract_parts.texts import cause
from stlbench.errors import UsageError
from stlbench.outside.again import score_again
from stlbench.result import CellId, Result, Score
from stlbench.sharing.checked import results_in, unpacked
from stlbench.task import load_task

__all__ = ["MORE", "Rescored", "rescore", "score_cell"]

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
        for result in results_in(folder):
            if (found := score_cell(result, folder)) is not None:
                yield found


def score_cell(result: Result, folder: Path) -> Rescored | None:
    """The same of one cell of an unpacked bundle; None where it has no policy."""
    if result.measurement is None or result.measurement.policies is None:
        return None
    recorded = result.measurement.selected
    try:
        again = score_again(load_task(result.id.task), result, folder, "selected")
    except UsageError as error:
        return Rescored(result.id, recorded, None, str(error))
    except Exception as error:  # whatever arrays of others do, the next cell is scored
        return Rescored(result.id, recorded, None, cause(error))
    return Rescored(result.id, recorded, again.scores)
