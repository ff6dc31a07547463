"""Cells to results: skips what is finished, runs the rest on an executor, records each result as it ends."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace

from stlbench.contract import Executor, Outcome
from stlbench.result import Result
from stlbench.study.ledger import Ledger
from stlbench.study.matrix import Cell

__all__ = ["run"]


def run(
    cells: Sequence[Cell],
    ledger: Ledger,
    executor: Executor,
    run_cell: Callable[[Cell], Result],
    deadlines: Sequence[float],
    provenance: Mapping[str, str],
    retry: bool = False,
) -> Generator[Result]:
    """Yield the result of each cell that was not finished, as they end. A result is in the ledger when it is yielded.

    ctrl-C, or closing the iterator, stops the workers; what ended before is recorded.

    Args:
        cells: what to have results of, in the order in which to begin.
        ledger: says what is finished, and takes the rest.
        executor: runs the cells.
        run_cell: an importable function. What it raises becomes a result with status `raised`.
        deadlines: wall seconds for each of the cells.
        provenance: put on every result that is recorded (see `provenance.collect`).
        retry: run cells again that raised, or were stopped or killed.
    """
    finished = ledger.finished((cell.key for cell in cells), retry)
    limits = {cell: limit for cell, limit in zip(cells, deadlines, strict=True) if cell.key not in finished}
    todo = tuple(limits)
    with closing(executor.run(run_cell, todo, tuple(limits.values()))) as outcomes:
        for outcome in outcomes:
            result = replace(_result(todo[outcome.index], outcome), provenance=provenance)
            ledger.record(result)
            yield result


def _result(cell: Cell, outcome: Outcome) -> Result:
    if outcome.status != "done":
        return cell.ended(outcome.status, outcome.reason, outcome.details)
    if isinstance(outcome.value, Result) and outcome.value.key == cell.key:
        return outcome.value
    return cell.ended("raised", f"the cell's function returned no result of this cell but {outcome.value!r:.200}")
