"""Where a folder has its results: in its ledger, else in `cells.jsonl`, which holds the same as text for git."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Self

from stlbench.errors import UsageError
from stlbench.identity import CellId
from stlbench.registry import folders
from stlbench.result import Result, from_json, to_json
from stlbench.study.ledger import FILE, Ledger
from stlbench.study.provenance import TASK_FOLDER

__all__ = ["LINES", "SUFFIX", "OneByOne", "lines", "locate", "missing", "read", "write_lines"]

SUFFIX = ".jsonl"
"""Of files of lines."""

LINES = "cells" + SUFFIX
"""Name of the text file in a folder of results: one result per line, ordered by cell, nothing rounded and nothing
left out but the paths of tasks that are folders."""


def locate(path: Path) -> Path | None:
    """The file that has the results: `path` itself, or the ledger, else `cells.jsonl` of a folder. None without one."""
    candidates = (path / FILE, path / LINES) if path.is_dir() else (path,)
    return next((file for file in candidates if file.is_file()), None)


def read(path: Path) -> Iterator[Result]:
    """One result of every cell in a folder, a ledger or a file of lines, one at a time.

    A task of a ledger that is a folder is known from then on, where its folder is still there.

    Raises:
        UsageError: there is none of these, or a file is not as it should be; the message says where.
    """
    file = _existing(path)
    if file.suffix == SUFFIX:
        yield from _read_lines(file)
        return
    with Ledger(file, create=False) as ledger:
        for result in ledger.results():
            folders.recall(result.provenance.get(TASK_FOLDER))
            yield result


class OneByOne(Mapping[CellId, Result]):
    """The results of `read`, each read when it is asked for: of a ledger no more than one is in memory.

    A context manager. Raises `UsageError` as `read`; a row that is damaged is not there, with a `LedgerWarning`.
    """

    def __init__(self, path: Path) -> None:
        file = _existing(path)
        self._lines = {result.id: result for result in _read_lines(file)} if file.suffix == SUFFIX else None
        self._ledger = None if self._lines is not None else Ledger(file, create=False)
        self._rows = self._ledger.present() if self._ledger else {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        if self._ledger is not None:
            self._ledger.close()

    def __getitem__(self, cell: CellId) -> Result:
        if self._lines is not None:
            return self._lines[cell]
        assert self._ledger is not None
        result = self._ledger.read(self._rows[cell])
        if result is None:
            raise KeyError(cell)
        return result

    def __iter__(self) -> Iterator[CellId]:
        return iter(self._rows if self._lines is None else self._lines)

    def __len__(self) -> int:
        return len(self._rows if self._lines is None else self._lines)


def missing(path: Path) -> list[CellId]:
    """The cells that were planned and have no result; a file of lines knows no plan. Raises `UsageError` as `read`."""
    file = _existing(path)
    if file.suffix == SUFFIX:
        return []
    with Ledger(file, create=False) as ledger:
        return ledger.missing()


def write_lines(results: Iterable[Result], path: Path) -> int:
    """Write results as text, over the file of before; how many there are. Raises `UsageError` where it cannot."""
    text = lines(results)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error}") from error
    return text.count("\n")


def lines(results: Iterable[Result]) -> str:
    """The text of `cells.jsonl`: one line per result, ordered by cell."""
    return "".join(to_json(_without_path(result)) + "\n" for result in sorted(results, key=lambda result: result.id))


def _without_path(result: Result) -> Result:
    """A path of this machine is nobody else's, and lines that others wrote should not say where code is."""
    facts = {name: value for name, value in result.provenance.items() if name != TASK_FOLDER}
    return replace(result, provenance=facts)


def _existing(path: Path) -> Path:
    file = locate(path)
    if file is None:
        where = f"there is neither {path / FILE} nor {LINES}"
        raise UsageError(f"{where}; `stlbench run` writes the one, `stlbench export` the other")
    return file


def _read_lines(path: Path) -> Iterator[Result]:
    lines = dict[CellId, int]()
    try:
        with path.open(encoding="utf-8") as file:
            for number, text in enumerate(file, 1):
                result = _parsed(text, f"{path}, line {number}")
                if (first := lines.setdefault(result.id, number)) != number:
                    raise UsageError(f"{path}, line {number}: {result.id.name} is in line {first} already")
                yield result
    except (OSError, UnicodeError) as error:
        raise UsageError(f"cannot read {path}: {error}") from error


def _parsed(text: str, where: str) -> Result:
    try:
        return from_json(text)
    except ValueError as error:
        cause = str(error).splitlines()[0]
        raise UsageError(f"{where}: not a result as `stlbench export --format jsonl` writes it: {cause}") from error
