"""A study, from its description to its results: find what is missing, run it, record it. Prints nothing.

First a look without the lock says what is missing, and that alone is checked. Then under the lock of the folder it is
looked up once more, as another process may have written meanwhile, and runs.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from stlbench.contract import Executor, Work
from stlbench.errors import counted
from stlbench.records import results_folder
from stlbench.records.identity import CellId
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.result import Result, Status
from stlbench.records.result_files import cell_files, writing
from stlbench.study import scheduler, trial
from stlbench.study.cell import Cell
from stlbench.study.code_changes import outdated, outdated_note, run_checked
from stlbench.study.credibility import ConsistencyCheck
from stlbench.study.logs import Callback, Listener, Logged, Silent, build_logs, listening
from stlbench.study.plan import check_cells, examples, preload, uncompiled
from stlbench.study.provenance import collect, here
from stlbench.study.results import Results
from stlbench.study.scheduler import build_executor
from stlbench.study.study import Study

Until = Callable[[Result], bool]
"""Of a result: whether the study ends with it."""


def run_study(
    study: Study | str | Path | None = None,
    *,
    progress: Listener | Callback | bool | None = None,
    until: Until | None = None,
    **options: Any,
) -> Results:
    """Train and score every task, method, agent and seed: `stlbench run` in Python.

    Each cell is recorded in the folder of results as it ends. The same call again runs only what is missing there, so
    a study that was interrupted goes on. Workers are fresh processes, which do not run your script again.

    Args:
        study: a YAML file whose keys are the fields of `Study`, or the study itself.
        progress: True prints a line on stderr as each cell ends, and shows a bar in a terminal. A function is called
            with how many cells have a result, of how many, and the last result. A `Listener` is told all.
        until: the study ends, and what runs is stopped, with the first result of which it is true. Results from before
            count too.
        options: fields of `Study`, as Python values or as texts of the command line: `tasks=["overlap"], seeds=3`. They
            go before those of `study`; None leaves a field out.

    Returns:
        The results of these cells, those from before too. A method that does not fit a task, and a cell that failed,
        is a result with its status and reason.

    Raises:
        UsageError: a name, a value or the file is wrong; nothing has run then.
    """
    described = Study.of({name: value for name, value in options.items() if value is not None}, study)
    with listening(progress) as listener:
        cells = run_missing(described, listener, until)
    return Results.of(results_of(cells, described.folder), described.folder)


def results_of(cells: Iterable[Cell], folder: Path) -> list[Result]:
    """The results that the folder's ledger has of these cells."""
    with Ledger(folder / LEDGER, create=False) as ledger:
        return list(ledger.results_of(cell.id for cell in cells))


def run_missing(study: Study, progress: Listener | None = None, until: Until | None = None) -> tuple[Cell, ...]:
    """Run what is missing of a study, and return its cells. No result is kept in memory. Raises as `run_study`."""
    logs = build_logs(study.log)
    cells, place = study.cells(), build_executor(study.executor, study.jobs, study.memory)
    with Logged(logs, study.folder, progress or Silent()) as logged:
        run_cells(
            cells,
            study.folder,
            place,
            retry=study.retry,
            attempts=study.attempts,
            keep_old=study.keep_old,
            progress=logged,
            until=until,
        )
    return cells


def missing_cells(study: Study, cells: Sequence[Cell]) -> tuple[list[Cell], list[Result]]:
    """Those of a study's cells that would run, and the results that its folder has. Nothing is written."""
    recorded = [*results_folder.read(study.folder)] if results_folder.locate(study.folder) else []
    with _looked_up(study.folder, recorded) as ledger:
        missing, _ = _lacking(cells, study.retry, study.attempts, study.keep_old, ledger)
    return missing, recorded


@contextmanager
def _looked_up(folder: Path, recorded: Sequence[Result]) -> Iterator[Ledger]:
    """The ledger of a folder, else one elsewhere with its results, as a run would write it."""
    if results_folder.locate(folder) == (own := folder / LEDGER):
        with Ledger(own) as ledger:
            yield ledger
        return
    with TemporaryDirectory() as elsewhere, Ledger(Path(elsewhere) / LEDGER) as ledger:
        if recorded:
            ledger.fill({result.key: result.id for result in recorded}, recorded)
        yield ledger


def run_cells(
    cells: Sequence[Cell],
    folder: Path,
    executor: Executor,
    *,
    retry: Collection[Status] = (),
    attempts: int | None = None,
    keep_old: bool | None = None,
    progress: Listener | None = None,
    until: Until | None = None,
) -> None:
    """Run those of the cells that have no result in the folder's ledger, and record each as it ends.

    The plan is recorded first, so that a report knows what an interrupted study lacks. An interrupt
    (`KeyboardInterrupt`) stops the workers; what ended before is recorded, and the same call goes on. Cells that ended
    as `retry` says run again, unless they failed `attempts` times in a row. `keep_old` counts results of other code as
    done. Nothing runs after a result of which `until` is true, also one from before. Raises `UsageError` if a plugin
    cannot be loaded, or the ledger is none, or another process writes in the folder; then nothing ran, and nothing was
    written.
    """
    progress, today, place = progress or Silent(), collect(executor.jobs), folder.absolute()
    known = {cell.key for cell in cells}

    def look(ledger: Ledger) -> tuple[list[Cell], list[str], int]:
        """The cells that would run, lines on why, and how many have a result."""
        missing, old = _lacking(cells, retry, attempts, keep_old, ledger)
        notes = [outdated_note(old, ledger, today, keep_old)] if old else []
        if retry and attempts and (lost := ledger.given_up(known, attempts)):
            notes.append(_given_up(lost, attempts))
        over = until is not None and any(map(until, ledger.results(known)))
        return [] if over else missing, notes, len(cells) - len(missing)

    with Ledger(folder / LEDGER) as ledger:
        checked = check_cells(look(ledger)[0])
    with writing(folder), Ledger(folder / LEDGER) as ledger:
        results_folder.take_over(folder, ledger)
        missing, notes, done = look(ledger)
        ledger.plan({cell.key: cell.id for cell in cells})
        progress.begin([cell.id for cell in missing], done)
        for line in (*notes, *checked.notes):
            progress.note(line)
        for agent, compile_it in uncompiled(checked.agents, missing):
            progress.note(f"compiling {agent}, once per machine")
            compile_it()
        in_folder = partial(run_checked, run_cell=trial.run_cell, folder=place)  # a worker may have another directory
        work = Work(in_folder, partial(preload, examples(missing)), partial(_log_of, place), here)
        with (
            ConsistencyCheck(missing, place) as examined,
            closing(scheduler.run(missing, ledger, executor, work, today, examined)) as results,
        ):
            for result in results:
                progress.ended(result)
                if until is not None and until(result):
                    break


def _lacking(
    cells: Sequence[Cell], retry: Collection[Status], attempts: int | None, keep_old: bool | None, ledger: Ledger
) -> tuple[list[Cell], dict[str, Cell]]:
    """The cells that would run, and those that have a result of other code, by its key."""
    known = {cell.key: cell for cell in cells}
    finished = ledger.finished(known, retry, attempts)
    missing = [cell for key, cell in known.items() if key not in finished]
    old = outdated(missing, ledger) if missing else {}
    kept = {cell.id for cell in old.values()} if keep_old else set[CellId]()
    return [cell for cell in missing if cell.id not in kept], old


def _given_up(cells: Sequence[CellId], attempts: int) -> str:
    named = ", ".join(cell.name for cell in cells[:3]) + (", ..." if len(cells) > 3 else "")
    text = f"{counted(len(cells), 'cell')} failed {attempts} times or more in a row, given up: {named}"
    return f"{text}; --attempts with a greater number tries again"


def _log_of(results: Path, cell: Cell) -> Path:
    return cell_files(results, cell.id, cell.key).log
