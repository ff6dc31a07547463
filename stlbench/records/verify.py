"""Checks a folder of results: the ledger, each row, and the files of traces and policies, by their checksums."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from stlbench.errors import UsageError, one_line
from stlbench.records import stored
from stlbench.records.identity import CellId
from stlbench.records.inputs import names
from stlbench.records.ledger import FILE, Ledger
from stlbench.records.lines import is_lines
from stlbench.records.lock import writing
from stlbench.records.outputs import POLICIES, TRACES, cell_files, end_of_name
from stlbench.records.result import Result
from stlbench.records.rows import checksums_beside
from stlbench.records.schema import way_out


class Damage(NamedTuple):
    key: str  # of the cell
    cell: CellId | None  # None if it cannot be read
    what: str  # row, traces or policies
    problem: str
    own_key: str = ""  # the key of its result, if the columns of its row are damaged, perhaps also `key`

    @property
    def name(self) -> str:
        return (
            f"the cell with key {one_line(self.key)}" if self.cell is None else f"{self.cell.name} {self.cell.budget}"
        )


class Verified(NamedTuple):
    rows: int  # how many were checked
    files: int  # how many have the recorded checksum
    structure: tuple[str, ...]  # what SQLite reports about the ledger's structure; its rows are not read then
    damages: tuple[Damage, ...]
    marked: int  # how many cells the next run measures
    strays: tuple[str, ...] = ()
    """Files of traces and policies in the folder without a row and a plan: rows may be lost."""

    @property
    def is_whole(self) -> bool:
        return not (self.structure or self.damages or self.strays)


def verify(folder: Path) -> Verified:
    """Check all that is recorded in a folder; nothing is written. Raises `UsageError` without results."""
    if (file := stored.locate(folder)) is not None and is_lines(file):
        return Verified(sum(1 for _ in stored.read(folder)), 0, (), (), 0)
    with Ledger(folder / FILE, create=False) as ledger:
        if problems := ledger.problems():
            return Verified(0, 0, tuple(problems), (), 0)
        damages, there, rows, files, marked = list[Damage](), set[str](), 0, 0, 0
        for row in ledger.recorded():
            rows, marked = rows + 1, marked + row.again
            there.update((row.key, row.own_key))
            if isinstance(row.result, str):
                damages.append(Damage(row.key, row.cell, "row", row.result, row.own_key))
            else:
                changed = list(_changed(folder, row.files, row.result))
                damages += changed
                files += len(row.files) - len(changed)
        sound = not any(damage.what == "row" for damage in damages)  # else a row may have another key
        gone = {key: cell for key, cell in ledger.written().items() if key not in there}
        damages += [Damage(key, cell, "row", "it was recorded, and is not there") for key, cell in gone.items()]
        keys = {*(row.key for row in ledger.listed()), *ledger.planned(), *gone}
        return Verified(
            rows=rows,
            files=files,
            structure=(),
            damages=tuple(damages),
            marked=marked,
            strays=tuple(_strays(folder, keys)) if sound else (),
        )


def _strays(folder: Path, keys: Iterable[str]) -> Iterator[str]:
    """A name ends in the beginning of a key. The plan has the key of a cell that was interrupted."""
    known = {end_of_name(key) for key in keys}
    lengths = {len(end) for end in known}
    for kind in (TRACES, POLICIES):
        for name in names(folder / kind, folder, ".npz"):
            if not any(name[-length:] in known for length in lengths):
                yield f"{kind}/{one_line(name)}"


def _changed(folder: Path, checksums: Mapping[str, str], result: Result) -> Iterator[Damage]:
    paths, there = cell_files(folder, result.id, result.key), checksums_beside(folder, result)
    for what, path in (("traces", paths.traces), ("policies", paths.policies)):
        if what in checksums and there.get(what) != checksums[what]:
            lacking = "is a link, or no file" if os.path.lexists(path) else "is missing"
            problem = "is not as it was recorded" if what in there else lacking
            yield Damage(result.key, result.id, what, f"{path} {problem}")


def repair(folder: Path) -> Verified:
    """Mark the cells with a damaged or missing part, so that the next run measures them; what was damaged.

    Their results stay until then. Raises `UsageError` if the structure of the ledger is damaged.
    """
    with writing(folder):
        checked = verify(folder)
        if checked.structure:
            raise UsageError(f"the ledger {folder / FILE} is damaged; {way_out(folder / FILE)}")
        if checked.damages:
            with Ledger(folder / FILE) as ledger:
                for damage in checked.damages:
                    ledger.mark(damage.key, damage.own_key or damage.key)
    return checked
