"""The results of a folder: from its ledger, else from `cells.jsonl`, which has the same as text for git."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, partial
from io import TextIOWrapper
from pathlib import Path
from typing import Self, TypeVar

from pydantic import TypeAdapter

from stlbench.errors import UsageError
from stlbench.records.identity import CellId, ReadCell
from stlbench.records.inputs import followed, to_read
from stlbench.records.ledger import FILE, Ledger
from stlbench.records.outputs import write
from stlbench.records.result import TASK_FOLDER, Result, from_json, plain, to_json
from stlbench.records.schema import LONGEST
from stlbench.records.status import NOT_RUN

_T = TypeVar("_T")
SUFFIX = ".jsonl"  # of files of lines
LINES = "cells" + SUFFIX
"""Name of the text file in a folder of results: one cell per line, ordered, nothing rounded and nothing left out but
the paths of tasks that are folders. A cell that was planned and has no result is there with the status `not run`."""


def locate(path: Path) -> Path | None:
    """The file that has the results: `path` itself, or the ledger, else `cells.jsonl` of a folder. None without one.

    A link that the user names is followed; one in a folder is refused by what reads it.
    """
    candidates = (path / FILE, path / LINES) if path.is_dir() else (followed(path),)
    return next((file for file in candidates if file.is_file()), None)


def read(path: Path) -> Iterator[Result]:
    """One result of every cell in a folder, a ledger or a file of lines, one at a time.

    Nothing that a result names is imported. A task that is a folder is known only if the user named the folder. Raises
    `UsageError` if there is no such file, or it is damaged.
    """
    file = _existing(path)
    if file.suffix == SUFFIX:
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
    file = _existing(path)
    if file.suffix == SUFFIX:
        yield {result.id: result for result in _read_lines(file)}.get
        return
    with Ledger(file, create=False) as ledger:
        rows = ledger.present()
        yield lambda cell: ledger.read(rows[cell]) if cell in rows else None


def missing(path: Path) -> dict[str, CellId]:
    """The cells that were planned and have no result, by their keys in the plan. Raises `UsageError` as `read`."""
    file = _existing(path)
    if file.suffix == SUFFIX:
        entries = (_checked(_Planned.of, text, where) for text, where in _texts(file))
        return {planned.key: planned.cell for planned in entries if planned}
    with Ledger(file, create=False) as ledger:
        lacking = set(ledger.missing())
        return {key: cell for key, cell in ledger.planned().items() if cell in lacking}


def take_over(folder: Path, ledger: Ledger) -> None:
    """Give the ledger of a folder, where it is empty, what `cells.jsonl` says: a study that is kept as text goes on.

    Raises `UsageError` as `read`; then the ledger stays empty.
    """
    lines = folder / LINES
    if lines.is_file() and ledger.is_empty:
        results = list(_read_lines(lines))
        ledger.fill({**missing(lines), **{result.key: result.id for result in results}}, results)


def write_lines(results: Iterable[Result], path: Path, planned: Mapping[str, CellId] | None = None) -> int:
    """Write `lines` into a file; how many there are. Raises `UsageError` if that is not possible."""
    text = lines(results, planned)
    write(path, text)
    return text.count("\n")


def lines(results: Iterable[Result], planned: Mapping[str, CellId] | None = None) -> str:
    """The text of `cells.jsonl`: one line per result, and per cell that was `planned` and has none, ordered by cell."""
    texts = [(result.id, to_json(_without_path(result))) for result in results]
    texts += [(cell, _Planned(cell, key).text) for key, cell in (planned or {}).items()]
    return "".join(text + "\n" for _, text in sorted(texts))


@dataclass(frozen=True)
class _Planned:
    cell: CellId
    key: str

    @property
    def text(self) -> str:
        identity = _identity().dump_python(self.cell, mode="json")
        return json.dumps({**identity, "key": self.key, "status": NOT_RUN})

    @classmethod
    def of(cls, text: str) -> Self | None:
        """The content of a line; None if it is of a result. Raises `ValueError` if a part is missing or wrong."""
        if NOT_RUN not in text:
            return None
        content = plain(text)
        if not isinstance(content, dict) or content.pop("status", "") != NOT_RUN:
            return None
        return cls(key=str(content.pop("key", "")), cell=_identity().validate_python(content))


@cache
def _identity() -> TypeAdapter[CellId]:
    return TypeAdapter[CellId](ReadCell)


def _without_path(result: Result) -> Result:
    """A path of this machine means nothing elsewhere, and lines from elsewhere should not say where code is."""
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
    for number, (text, where) in enumerate(_texts(path), 1):
        entry = _checked(_Planned.of, text, where) or _checked(from_json, text, where)
        cell = entry.id if isinstance(entry, Result) else entry.cell
        if (first := lines.setdefault(cell, number)) != number:
            raise UsageError(f"{where}: {cell.name} is in line {first} already")
        if isinstance(entry, Result):
            yield entry


def _texts(path: Path) -> Iterator[tuple[str, str]]:
    try:
        with TextIOWrapper(to_read(path, path.parent), encoding="utf-8") as file:
            for number, text in enumerate(iter(partial(file.readline, LONGEST + 1), ""), 1):
                if len(text) > LONGEST:
                    raise UsageError(f"{path}, line {number}: it has more than {LONGEST >> 20} MiB")
                yield text, f"{path}, line {number}"
    except (OSError, UnicodeError) as error:
        raise UsageError(f"cannot read {path}: {error}") from error


def _checked(parse: Callable[[str], _T], text: str, where: str) -> _T:
    try:
        return parse(text)
    except ValueError as error:
        cause = str(error).splitlines()[0]
        raise UsageError(f"{where}: not a result as `stlbench export --format jsonl` writes it: {cause}") from error
