"""Cells to results: runs them on an executor, and records each result as it ends."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace

from stlbench.contract import Executor, Outcome, cause
from stlbench.errors import DiskFull, one_line
from stlbench.records.ledger import Ledger
from stlbench.records.result import Result, from_json, to_json
from stlbench.study.cell import Cell
from stlbench.study.executed import outcomes
from stlbench.study.provenance import elsewhere, of_cell
from stlbench.study.unchanged import NoSpace, key_without_code


def run(
    cells: Sequence[Cell],
    ledger: Ledger,
    executor: Executor,
    run_cell: Callable[[Cell], Result],
    provenance: Mapping[str, str],
    accepted: Callable[[Cell, Result, float], Result] = lambda cell, result, seconds: result,
) -> Generator[Result]:
    """Yield the result of each cell, as they end. A result is in the ledger when it is yielded.

    ctrl-C, or closing the iterator, stops the workers; what ended before is recorded. So it is with a full disk, and
    with an executor that fails, which raise `UsageError`.

    Args:
        cells: what to run, in the order in which to begin.
        ledger: takes the results.
        executor: runs the cells.
        run_cell: an importable function. What it raises becomes a result with status `raised`.
        provenance: added to that of every result that is recorded (see `provenance.collect`); of one of another machine
            what is of the run.
        accepted: looks at what a cell returned, and at how many seconds ago the first cell began; gives the result that
            is recorded.
    """
    begun = time.monotonic()
    with closing(outcomes(executor, run_cell, cells, [cell.deadline for cell in cells])) as ended:
        for outcome in ended:
            cell = cells[outcome.index]
            result = accepted(cell, _result(cell, outcome), time.monotonic() - begun)
            where = provenance if outcome.facts is None else elsewhere(provenance, outcome.facts)
            result = replace(result, provenance={**result.provenance, **where, **of_cell(cell)})
            ledger.record(result)
            yield result


def _result(cell: Cell, outcome: Outcome) -> Result:
    if outcome.status != "done":
        return cell.ended(outcome.status, outcome.reason, outcome.details)
    if isinstance(outcome.value, NoSpace):
        raise DiskFull(f"cannot store what {cell.id.name} gave: {outcome.value.reason}")
    if not (isinstance(outcome.value, Result) and outcome.value.key in (cell.key, key_without_code(cell))):
        said = one_line(_Shown(outcome.value))[:200]
        return cell.ended("raised", f"the cell's function returned no result of this cell but {said}")
    try:
        return from_json(to_json(outcome.value))
    except (TypeError, ValueError) as error:  # a plugin's value of a wrong type somewhere in it
        return cell.ended("raised", f"the cell's result cannot be written: {cause(error)}")


class _Shown:
    """Something of a plugin, whose text is its `repr`."""

    def __init__(self, value: object) -> None:
        self._value = value

    def __str__(self) -> str:
        return repr(self._value)
