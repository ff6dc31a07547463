"""The upkeep of folders of results: cells taken out, folders put together."""

from __future__ import annotations

import re
import shutil
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import NamedTuple, get_args

from stlbench.errors import UsageError, did_you_mean
from stlbench.result import CellId, Result, Status
from stlbench.study import stored
from stlbench.study.beside import files_beside
from stlbench.study.ledger import FILE, Ledger
from stlbench.study.lock import writing
from stlbench.study.results import Results

__all__ = ["Merged", "choose", "merge", "remove", "take_out"]


def choose(
    folder: Path,
    names: Collection[str] | None = None,
    statuses: Collection[str] | None = None,
    budget: str | None = None,
) -> list[Result]:
    """The results in a folder's ledger that fit all that is said; what is None or empty is not said.

    Args:
        folder: of results.
        names: of cells; `*` stands for any characters.
        statuses: how they ended.
        budget: of the cells.

    Raises:
        UsageError: nothing is said, a name or status fits no cell, or there is no ledger.
    """
    if not (names or statuses or budget):
        raise UsageError("which cells? Name them, or say --status or --budget")
    for status in statuses or ():
        if status not in get_args(Status):
            raise UsageError(f"no status '{status}'{did_you_mean(status, get_args(Status))}")
    with Ledger(folder / FILE, create=False) as ledger:
        results = list(ledger.results())
    if names:
        known = {result.id.name for result in results}
        fitting = [pattern for name in names if (pattern := _pattern(name, known))]
        results = [result for result in results if any(pattern.fullmatch(result.id.name) for pattern in fitting)]
    chosen = [
        result
        for result in results
        if (not statuses or result.status in statuses) and budget in (None, result.id.budget)
    ]
    if not chosen:
        raise UsageError(f"no such cell in {folder / FILE}")
    return chosen


def _pattern(name: str, known: Collection[str]) -> re.Pattern[str]:
    """A name with `*` in it, which has to fit one of the known; brackets mean themselves."""
    pattern = re.compile(".*".join(map(re.escape, name.split("*"))))
    if not any(map(pattern.fullmatch, known)):
        raise UsageError(f"there is no cell '{name}'{did_you_mean(name, known)}")
    return pattern


def remove(folder: Path, cells: Iterable[CellId]) -> None:
    """Take cells out of a folder's ledger, with all that is recorded of them, their traces, policies and logs."""
    with writing(folder), Ledger(folder / FILE, create=False) as ledger:
        for cell in cells:
            take_out(folder, ledger, cell)


def take_out(folder: Path, ledger: Ledger, cell: CellId) -> None:
    """Take one cell out, for what writes in the folder already."""
    for key in ledger.remove(cell):
        for file in files_beside(folder, cell, key):
            file.unlink(missing_ok=True)


class Merged(NamedTuple):
    """How many cells of a folder went into another."""

    added: int
    """That were not there."""
    replaced: int
    """In place of an older result."""
    kept: int
    """Left out, as there is one there that is not older."""


def merge(into: Path, source: Path) -> Merged:
    """Copy the results of `source` into the ledger of `into`, and their traces, policies and logs.

    Of two results of a cell the one stays whose run began later, and where both began together that of `into`.

    Raises:
        UsageError: `source` has no results, or it is `into` itself.
    """
    if into.resolve() == source.resolve():
        raise UsageError(f"{source} cannot be merged into itself")
    incoming = Results.load(source)
    if stored.locate(into) and not (into / FILE).is_file():
        raise UsageError(f"{into} has no {FILE} but {stored.LINES}; merge into a new folder, and export that")
    added = replaced = 0
    with writing(into), Ledger(into / FILE) as ledger:
        present = {result.id: result for result in ledger.results()}
        for result in incoming:
            before = present.get(result.id)
            if before is not None and _begun(result) <= _begun(before):
                continue
            if before is not None:
                take_out(into, ledger, before.id)
            _copy_files(incoming.folder, into, result)
            ledger.record(result)
            added, replaced = added + (before is None), replaced + (before is not None)
    return Merged(added, replaced, len(incoming) - added - replaced)


def _begun(result: Result) -> str:
    """When its run began, in UTC, so that texts compare as times do; empty where it is not known."""
    return result.provenance.get("time", "")


def _copy_files(source: Path, into: Path, result: Result) -> None:
    pairs = zip(files_beside(source, result.id, result.key), files_beside(into, result.id, result.key), strict=True)
    for recorded, copy in pairs:
        if recorded.is_file():
            try:
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(recorded, copy)
            except OSError as error:
                raise UsageError(f"cannot copy {recorded}: {error}") from error
