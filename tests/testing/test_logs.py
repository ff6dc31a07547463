"""The checks of a log: what breaks a rule is told which."""

from __future__ import annotations

from pathlib import Path

import pytest

from stlbench.contract import LoggedCell, RunLog
from stlbench.testing import Rules, check_log


class Quiet(RunLog):
    """The least that a log is."""

    def ended(self, cell: LoggedCell) -> None: ...


def test_the_least_that_a_log_is() -> None:
    rules = Rules()
    check_log(Quiet, rules)
    assert len(rules.kept) == 7


class NoCells(Quiet):
    def begin(self, folder: Path, cells: tuple[str, ...]) -> None:
        self.first = cells[0]


class NoNumbers(Quiet):
    def ended(self, cell: LoggedCell) -> None:
        int(cell.numbers.get("robustness", 0))


class Once(Quiet):
    def begin(self, folder: Path, cells: tuple[str, ...]) -> None:
        for cell in cells:
            (folder / cell).mkdir(parents=True)


class NoCurve(Quiet):
    def ended(self, cell: LoggedCell) -> None:
        if cell.status == "done":
            cell.curve[-1]


class Ending(Quiet):
    def end(self) -> None:
        raise SystemExit(0)


@pytest.mark.parametrize(
    ("log", "rule"),
    [
        (Ending, "a run of no cells; got SystemExit: 0"),
        (NoCells, "a run of no cells; got IndexError"),
        (NoNumbers, "numbers that are none"),
        (Once, "the same cells again, in a second run; got FileExistsError"),
        (NoCurve, "a cell of which there was no checkpoint"),
    ],
)
def test_what_breaks_a_rule_is_told_which(log: type[RunLog], rule: str) -> None:
    with pytest.raises(AssertionError, match=rule):
        check_log(log)
