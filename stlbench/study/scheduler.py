"""Cells to results: runs them on an executor, and records each result as it ends."""

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from typing import Any, cast, get_args, get_type_hints

from stlbench.contract import Executor, Outcome, Unsuitable, cause
from stlbench.errors import DiskFull, UsageError, one_line
from stlbench.records.ledger import Ledger
from stlbench.records.result import Result, from_json, to_json
from stlbench.registry import plugins
from stlbench.registry.choices import LOCAL, Choice, executor_of
from stlbench.study.cell import Cell
from stlbench.study.code_changes import NoSpace, key_without_code
from stlbench.study.provenance import elsewhere, of_cell

_OVER = object()
_STATUSES = get_args(get_type_hints(Outcome)["status"])


def run(
    cells: Sequence[Cell],
    ledger: Ledger,
    executor: Executor,
    run_cell: Callable[[Cell], Result],
    provenance: Mapping[str, str],
    accepted: Callable[[Cell, Result], Result] = lambda cell, result: result,
) -> Generator[Result]:
    """Yield the result of each cell, as they end. A result is in the ledger when it is yielded.

    ctrl-C, or closing the iterator, stops the workers; what ended before is recorded. The same holds for a full disk,
    and for an executor that fails, which raise `UsageError`. An error of `run_cell` becomes a result. `accepted` may
    replace the result of a cell.
    """
    with closing(outcomes(executor, run_cell, cells, [cell.deadline for cell in cells])) as ended:
        for outcome in ended:
            cell = cells[outcome.index]
            result = accepted(cell, _result(cell, outcome))
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
        kind = one_line(type(outcome.value).__name__)
        return cell.ended("raised", f"the cell's function returned no result of this cell but a value of type {kind}")
    try:
        return from_json(to_json(outcome.value))
    except (TypeError, ValueError) as error:  # a plugin's value of a wrong type somewhere in it
        return cell.ended("raised", f"the cell's result cannot be written: {cause(error)}")


def outcomes(
    executor: Executor, function: Callable[[Any], Any], items: Sequence[Any], deadlines: Sequence[float]
) -> Generator[Outcome]:
    """Yield what `executor.run` yields: one outcome per item, as they end.

    Raises `UsageError` if it raises anything, or gives no generator with an outcome for each item.
    """
    left = set(range(len(items)))
    rule = f"its run should be a generator with one outcome for each of {len(items)} items"
    with failing(executor):
        ended = executor.run(function, items, deadlines)
    if not isinstance(ended, Generator):
        raise UsageError(f"{_name(executor)}: {rule}, it gives {type(ended).__name__}")
    try:
        while True:
            with failing(executor):  # an error of who takes an outcome is none of the executor's
                outcome = next(ended, _OVER)
            if outcome is _OVER:
                break
            if not (isinstance(outcome, Outcome) and outcome.index in left):
                raise UsageError(f"{_name(executor)}: {rule}, it gives {one_line(repr(outcome))}")
            if problem := _wrong(outcome):
                raise UsageError(f"{_name(executor)}: its outcome has {problem}")
            left.remove(outcome.index)
            yield outcome
        if left:
            raise UsageError(f"{_name(executor)}: {rule}; {len(left)} of them are missing")
    finally:
        with failing(executor):
            ended.close()


def _wrong(outcome: Outcome) -> str:
    """Which part of an outcome is of another kind than the contract says; nothing where all are right."""
    if outcome.status not in _STATUSES:
        return f"the status {one_line(repr(outcome.status))}, the contract says {', '.join(_STATUSES)}"
    if not (isinstance(outcome.reason, str) and isinstance(outcome.details, str)):
        return "a reason or details that are no text"
    if not isinstance(outcome.facts, Mapping | None):
        return f"facts of type {type(outcome.facts).__name__}, the contract says a mapping or None"
    return ""


def build_executor(choice: Choice | str = LOCAL, jobs: int | None = None, memory: str | None = None) -> Executor:
    """The chosen executor, with so many `jobs` at a time, and so much `memory` for each cell, as in "4G".

    Raises `UsageError` if there is no such executor, it cannot run here, or a parameter is wrong.
    """
    chosen = executor_of(choice)
    given = {name: value for name, value in (("jobs", jobs), ("memory", memory)) if value is not None}
    with failing(chosen.name):
        return cast(Executor, plugins.build("executors", chosen, defaults=given, origin=""))


@contextmanager
def failing(executor: Executor | str) -> Iterator[None]:
    """An error of an executor, or one of that name, is a `UsageError`."""
    try:
        yield
    except UsageError:
        raise
    except Unsuitable as error:  # it cannot run here
        raise UsageError(one_line(error)) from error
    except (Exception, SystemExit) as error:
        raise UsageError(f"{_name(executor)} failed: {cause(error)}") from error


def _name(executor: Executor | str) -> str:
    """Looked up after an error alone, as it imports all executors."""
    name = executor if isinstance(executor, str) else plugins.name_of("executors", type(executor))
    return f"executor {type(executor).__name__}" if name is None else str(plugins.find("executors", name))
