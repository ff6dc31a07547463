"""A folder of results: a ledger, traces, policies and logs. Its results are those of the ledger, else of `cells.jsonl`,
else of `cells.jsonl.xz`.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from stlbench.errors import UsageError
from stlbench.records import lines
from stlbench.records.identity import CellId
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.result import Result
from stlbench.records.result_files import LINES, PACKED, followed


def locate(path: Path) -> Path | None:
    """The file that has the results: `path` itself, or that of a folder which goes before the others. None without one.

    An empty ledger beside lines that have results does not count: a run fills it from them (`take_over`). A link that
    the user names is followed; one in a folder is refused by what reads it.
    """
    candidates = tuple(path / name for name in (LEDGER, LINES, PACKED)) if path.is_dir() else (followed(path),)
    there = [file for file in candidates if file.is_file()]
    if there[1:] and there[0].name == LEDGER and _is_empty(there[0]) and not _is_empty(there[1]):
        del there[0]
    return next(iter(there), None)


def _is_empty(file: Path) -> bool:
    """Whether a file has neither results nor a plan; of one that cannot be read, its reader says why."""
    try:
        if lines.is_lines(file):
            return not any(True for _ in lines.entries(file))
        with Ledger(file, create=False) as ledger:
            return ledger.is_empty
    except (UsageError, OSError):
        return False


def folder_of(path: Path) -> Path:
    """The folder of what `locate` takes: a file's own, else the path itself."""
    return path.parent if path.is_file() else path


def read(path: Path) -> Iterator[Result]:
    """One result of every cell in a folder, a ledger or a file of lines, one at a time.

    Nothing that a result names is imported. A task that is a folder is known only if the user named the folder. Raises
    `UsageError` if there is no such file, or it is damaged.
    """
    file = existing(path)
    if lines.is_lines(file):
        yield from _read_lines(file)
        return
    with Ledger(file, create=False) as ledger:
        yield from ledger.results()


Find = Callable[[CellId], Result | None]
"""Gives the result of a cell; None where there is none."""


@contextmanager
def one_by_one(path: Path) -> Iterator[Find]:
    """Finds the results of `read`: of a ledger no more than one is in memory. For a damaged row it gives None, with a
    `LedgerWarning`."""
    file = existing(path)
    if lines.is_lines(file):
        yield {result.id: result for result in _read_lines(file)}.get
        return
    with Ledger(file, create=False) as ledger:
        rows = ledger.present()
        yield lambda cell: ledger.read(rows[cell]) if cell in rows else None


def missing(path: Path) -> dict[str, CellId]:
    """The cells that were planned and have no result, by their keys in the plan. Raises `UsageError` as `read`."""
    file = existing(path)
    if lines.is_lines(file):
        return {entry.key: entry.cell for entry in lines.entries(file) if isinstance(entry, lines.Lacking)}
    with Ledger(file, create=False) as ledger:
        lacking = set(ledger.missing())
        return {key: cell for key, cell in ledger.planned().items() if cell in lacking}


def take_over(folder: Path, ledger: Ledger) -> None:
    """Give an empty ledger what the lines of its folder say, and `cells.jsonl` what it lacks of the ledger.

    So a study that is kept as text goes on, and so does one whose ledger was taken away. Raises `UsageError` as `read`;
    then the ledger stays empty. It is raised too if `cells.jsonl` cannot be written.
    """
    file = next((folder / name for name in (LINES, PACKED) if (folder / name).is_file()), None)
    if file is not None and ledger.is_empty:
        entries = list(lines.entries(file))
        results = [entry for entry in entries if isinstance(entry, Result)]
        cells = {entry.key: entry.cell for entry in entries if isinstance(entry, lines.Lacking)}
        ledger.fill({**cells, **{result.key: result.id for result in results}}, results)
    known = lines.keys(folder)
    lacking = [row for row in ledger.present().values() if row.key not in known]
    lines.append(folder, (result for row in lacking if (result := ledger.read(row)) is not None))


def refuse_lines(folder: Path, way: str) -> None:
    """Raises `UsageError` where a folder has results and no ledger that could be written; `way` says what to do.

    It is raised for a file, too.
    """
    if folder.is_file():
        raise UsageError(f"{folder} is a file; name a folder of results")
    if (file := locate(folder)) and file.name != LEDGER:
        raise UsageError(f"{folder} has no {LEDGER} with results but {file.name}; {way}")


def existing(path: Path) -> Path:
    """The file that `locate` finds. Raises `UsageError` where there is none."""
    file = locate(path)
    if file is None:
        where = f"there is neither {path / LEDGER} nor {LINES}"
        raise UsageError(f"{where}; `stlbench run` writes both, `stlbench export` {PACKED}")
    return file


def _read_lines(file: Path) -> Iterator[Result]:
    return (entry for entry in lines.entries(file) if isinstance(entry, Result))
