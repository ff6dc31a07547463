"""A study, from its description to its results: plan it, run what is missing, record it. Prints nothing."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Protocol, cast, runtime_checkable

from stlbench.contract import Executor, Work
from stlbench.errors import UsageError
from stlbench.records import stored
from stlbench.records.identity import CellId
from stlbench.records.ledger import FILE, Ledger
from stlbench.records.result import Result, Status
from stlbench.records.result_files import cell_files, writing
from stlbench.registry import plugins
from stlbench.registry.choices import Choice, executor_of
from stlbench.study import scheduler, trial
from stlbench.study.cell import Cell
from stlbench.study.code_changes import outdated, outdated_note, run_checked
from stlbench.study.credibility import Examiner
from stlbench.study.logs import Logged, build_logs
from stlbench.study.plan import check_cells, examples, uncompiled, warm
from stlbench.study.provenance import collect, here
from stlbench.study.results import Results
from stlbench.study.scheduler import failing
from stlbench.study.study import Study


@runtime_checkable
class Progress(Protocol):
    """Hears how a study goes on."""

    def begin(self, missing: Sequence[CellId], done: int) -> None:
        """These cells are going to run; `done` others have a result from before."""

    def note(self, text: str) -> None:
        """Something that the user should know of the study, in a line."""

    def ended(self, result: Result) -> None:
        """One more cell has ended."""


class _Silent:
    def begin(self, missing: Sequence[CellId], done: int) -> None: ...

    def note(self, text: str) -> None: ...

    def ended(self, result: Result) -> None: ...


Callback = Callable[[int, int, Result], object]
"""Is called as each cell ends: how many have a result, of how many, and the last one."""


class _Calling(_Silent):
    def __init__(self, callback: Callback) -> None:
        self._callback, self._done, self._total = callback, 0, 0

    def begin(self, missing: Sequence[CellId], done: int) -> None:
        self._done, self._total = done, done + len(missing)

    def ended(self, result: Result) -> None:
        self._done += 1
        self._callback(self._done, self._total, result)


@contextmanager
def _progress(wanted: Progress | Callback | bool | None) -> Iterator[Progress]:
    if wanted is True:
        from stlbench.study.progress import Progress as Lines

        with Lines() as lines:
            yield lines
    elif isinstance(wanted, Progress):
        yield wanted
    else:
        yield _Calling(wanted) if wanted else _Silent()


def build_executor(choice: Choice | str = "local", jobs: int | None = None, memory: str | None = None) -> Executor:
    """The chosen executor, with so many `jobs` at a time, and so much `memory` for each cell, as in "4G".

    Raises `UsageError` if there is no such executor, it cannot run here, or a parameter is wrong.
    """
    text = chosen = executor_of(choice)
    if memory is not None:
        chosen = Choice(text.name, tuple({"memory": memory, **dict(text.parameters)}.items()))
    try:
        with failing(chosen.name):
            return cast(Executor, plugins.build("executors", chosen, defaults={} if jobs is None else {"jobs": jobs}))
    except UsageError as error:
        raise UsageError(str(error).replace(str(chosen), str(text))) from error  # by the name that the user gave it


def run_study(
    study: Study | str | Path | None = None,
    *,
    progress: Progress | Callback | bool | None = None,
    until: Callable[[Result], bool] | None = None,
    **options: Any,
) -> Results:
    """Train and score every task, method, agent and seed: `stlbench run` in Python.

    Each cell is recorded in the folder of results as it ends. The same call again runs only what is missing there, so
    a study that was interrupted goes on. Workers are fresh processes, which do not run your script again.

    Args:
        study: a YAML file whose keys are the fields of `Study`, or the study itself.
        progress: True prints a line on stderr as each cell ends, and shows a bar in a terminal. A function is called
            with how many cells have a result, of how many, and the last result. An object of `Progress` is told all.
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
    with _progress(progress) as listener:
        cells = run_missing(described, listener, until)
    with Ledger(described.folder / FILE, create=False) as ledger:
        return Results.of(ledger.results_of(cell.id for cell in cells), described.folder)


def run_missing(
    study: Study, progress: Progress | None = None, until: Callable[[Result], bool] | None = None
) -> tuple[Cell, ...]:
    """Run what is missing of a study, and return its cells. No result is kept in memory. Raises as `run_study`."""
    logs = build_logs(study.log)
    cells, place = study.cells(), build_executor(study.executor, study.jobs, study.memory)
    with Logged(logs, study.folder, progress or _Silent()) as logged:
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
    recorded = [*stored.read(study.folder)] if stored.locate(study.folder) else []
    ended = [result for result in recorded if result.status not in study.retry]
    done = {result.id if study.keep_old else result.key for result in ended}
    return [cell for cell in cells if (cell.id if study.keep_old else cell.key) not in done], recorded


def run_cells(
    cells: Sequence[Cell],
    folder: Path,
    executor: Executor,
    *,
    retry: Collection[Status] = (),
    attempts: int | None = None,
    keep_old: bool | None = None,
    progress: Progress | None = None,
    until: Callable[[Result], bool] | None = None,
    run_cell: Callable[..., Result] | None = None,
) -> None:
    """Run those of the cells that have no result in the folder's ledger, and record each as it ends.

    What is planned is recorded first, so that a report knows what an interrupted study lacks. An interrupt
    (`KeyboardInterrupt`) stops the workers; what ended before is recorded, and the same call goes on. Cells that ended
    as `retry` says run again, unless they failed `attempts` times in a row. `keep_old` counts results of other code as
    done. Nothing runs after a result of which `until` is true, also one from before. `run_cell` stands for
    `trial.run_cell`. Raises `UsageError` if a plugin cannot be loaded, or the ledger is none, or another process writes
    in the folder; then nothing ran, and nothing was written.
    """
    progress = progress or _Silent()
    provenance = collect(executor.jobs)
    with Ledger(folder / FILE) as ledger:
        notes = check_cells(_missing(cells, ledger, retry, attempts))
    with writing(folder), Ledger(folder / FILE) as ledger:
        stored.take_over(folder, ledger)
        missing = _missing(cells, ledger, retry, attempts)
        if retry and attempts and (lost := ledger.given_up({cell.key for cell in cells}, attempts)):
            notes = (_given_up(lost, attempts), *notes)
        if missing and (old := outdated(missing, ledger)):
            notes = (outdated_note(old, ledger, provenance, keep_old), *notes)
            kept = {cell.id for cell in old.values()} if keep_old else set[CellId]()
            missing = [cell for cell in missing if cell.id not in kept]
        done = len(cells) - len(missing)
        if until is not None and any(map(until, ledger.results({cell.key for cell in cells}))):
            missing = []
        ledger.plan({cell.key: cell.id for cell in cells})
        progress.begin([cell.id for cell in missing], done)
        for line in notes:
            progress.note(line)
        for agent, work in uncompiled(missing):
            progress.note(f"compiling {agent}, once per machine")
            work()
        place = folder.absolute()  # a worker elsewhere has another working directory
        in_folder = partial(run_checked, run_cell=run_cell or trial.run_cell, folder=place)
        work_on = Work(in_folder, partial(warm, examples(missing)), partial(_log_of, place), here)
        with (
            Examiner(missing, place) as examined,
            closing(scheduler.run(missing, ledger, executor, work_on, provenance, examined)) as results,
        ):
            for result in results:
                progress.ended(result)
                if until is not None and until(result):
                    break


def _given_up(cells: Sequence[CellId], attempts: int) -> str:
    named = ", ".join(cell.name for cell in cells[:3]) + (", ..." if len(cells) > 3 else "")
    text = f"{len(cells)} {'cell' if len(cells) == 1 else 'cells'} failed {attempts} times or more in a row"
    return f"{text}, given up: {named}; --attempts with a greater number tries again"


def _missing(cells: Iterable[Cell], ledger: Ledger, retry: Collection[Status], attempts: int | None) -> list[Cell]:
    known = {cell.key: cell for cell in cells}
    finished = ledger.finished(known, retry, attempts)
    return [cell for key, cell in known.items() if key not in finished]


def _log_of(results: Path, cell: Cell) -> Path:
    return cell_files(results, cell.id, cell.key).log
