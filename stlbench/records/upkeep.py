"""The upkeep of folders of results: cells taken out, folders put together."""

from __future__ import annotations

import re
import shutil
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple, get_args

from stlbench.errors import UsageError, did_you_mean
from stlbench.records import stored
from stlbench.records.identity import OUTSIDE, CellId
from stlbench.records.inputs import is_there, to_read
from stlbench.records.ledger import FILE, Ledger
from stlbench.records.lock import writing
from stlbench.records.outputs import LINES, cell_files, inside, opened
from stlbench.records.result import Result
from stlbench.records.status import ACCIDENTS, Status
from stlbench.records.verify import verify


def choose(
    folder: Path,
    names: Collection[str] | None = None,
    statuses: Collection[str] | None = None,
    budget: str | None = None,
) -> list[Result]:
    """The results in a folder's ledger that meet all conditions; in names, `*` stands for any characters.

    Raises `UsageError` if there is no condition or no ledger, or a name or status fits no cell.
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


def remove(folder: Path, cells: Collection[CellId]) -> None:
    """Take cells out. If results of other seeds stay, they are planned, so that tables say that a seed is missing;
    else what is planned of their setting goes too."""
    with writing(folder), Ledger(folder / FILE, create=False) as ledger:
        keys = ledger.counted()
        staying = {cell.setting for cell in keys.keys() - cells if cell.track != OUTSIDE}
        leaving = {cell.setting for cell in cells} - staying
        for cell in {*cells, *(cell for cell in ledger.planned().values() if cell.setting in leaving)}:
            take_out(folder, ledger, cell)
        ledger.plan_also({keys[cell]: cell for cell in cells if cell in keys and cell.setting in staying})


def take_out(folder: Path, ledger: Ledger, cell: CellId) -> None:
    """Take one cell out, for what writes in the folder already."""
    for key in ledger.remove(cell):
        for file in cell_files(folder, cell, key):
            inside(file, folder).unlink(missing_ok=True)


class Merged(NamedTuple):
    """The outcome of a merge, in numbers of cells."""

    added: int  # cells that the folder did not have
    replaced: int  # cells whose result was older, or a failure
    kept: int  # not copied: the folder has a newer result, or one that is no failure
    planned: int  # cells without a result in either folder
    conflicts: tuple[str, ...]  # names of cells with equal keys and different scores: one of the two results stays
    damaged: tuple[str, ...]  # files that differ from their checksums; they were not copied


def merge(into: Path, source: Path) -> Merged:
    """Copy the results of `source` into the ledger of `into`, their traces, policies and logs, and its plan.

    If both have a result of a cell, one that is no failure stays, else the one whose run began later, else that of
    `into`. An interrupted merge can be repeated. Raises `UsageError` if `source` has no results, or is `into` itself.
    """
    if into.resolve() == source.resolve():
        raise UsageError(f"{source} cannot be merged into itself")
    incoming = list(stored.read(source))
    if stored.locate(into) and not (into / FILE).is_file():
        raise UsageError(f"{into} has no {FILE} but {LINES}; merge into a new folder, and export that")
    damaged = {(damage.key, damage.what) for damage in verify(source).damages}
    counts, conflicts, left_out = Counter[str](), list[str](), list[str]()
    with writing(into), Ledger(into / FILE) as ledger:
        present = {result.id: result for result in ledger.results()}
        for result in incoming:
            before = present.get(result.id)
            conflicts += [] if before is None or _agree(result, before) else [result.id.name]
            if before is not None and not _is_better(result, before):
                counts["kept"] += 1
                continue
            if before is not None:
                take_out(into, ledger, before.id)
            left_out += _copy_files(source if source.is_dir() else source.parent, into, result, damaged)
            ledger.record(result)
            counts["added" if before is None else "replaced"] += 1
        planned = _plan(source, ledger)
    return Merged(counts["added"], counts["replaced"], counts["kept"], planned, tuple(conflicts), tuple(left_out))


def _is_better(result: Result, before: Result) -> bool:
    """No failure is better than a failure, then the later run. Times are in UTC, so that texts compare as times do."""

    def rank(one: Result) -> tuple[bool, str]:
        return one.status not in ACCIDENTS, one.provenance.get("time", "")

    return rank(result) > rank(before)


def _agree(result: Result, before: Result) -> bool:
    """Whether two results of one key have the same scores; times may differ."""
    one, other = result.measurement, before.measurement
    if result.key != before.key or one is None or other is None:
        return True
    return (one.selected, one.final) == (other.selected, other.final)


def _plan(source: Path, ledger: Ledger) -> int:
    """Take over the missing cells of the source's plan; the number of cells that are new to the ledger."""
    known = {*ledger.counted(), *ledger.planned().values()}
    new = {key: cell for key, cell in stored.missing(source).items() if cell not in known}
    ledger.plan_also(new)
    return len(new)


def _copy_files(source: Path, into: Path, result: Result, damaged: Collection[tuple[str, str]]) -> Iterator[str]:
    here, there = cell_files(source, result.id, result.key), cell_files(into, result.id, result.key)
    for kind, recorded in here._asdict().items():
        if (result.key, kind) in damaged:
            yield str(recorded)
        elif is_there(recorded, source):
            with to_read(recorded, source) as content, opened(getattr(there, kind), into) as copy:
                shutil.copyfileobj(content, copy)
