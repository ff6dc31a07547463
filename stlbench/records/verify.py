"""Is a folder of results whole? Its ledger, each row, and the files of traces and policies, by their checksums."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from stlbench.errors import one_line, unwritable
from stlbench.records import stored
from stlbench.records.cell_files import POLICIES, TRACES, cell_files, end_of_name
from stlbench.records.identity import CellId
from stlbench.records.ledger import FILE, Ledger
from stlbench.records.lock import writing
from stlbench.records.outputs import inside
from stlbench.records.reader import Recorded
from stlbench.records.result import Result
from stlbench.records.rows import checksums_beside

DAMAGED = FILE + ".damaged"
"""Where `repair` leaves a ledger of which a part cannot be read."""


_LOST = "it cannot be read"


class Damage(NamedTuple):
    """One thing that is not as it was recorded."""

    key: str
    """Of the cell."""
    cell: CellId | None
    """None where that cannot be read either."""
    what: str
    """row, traces or policies."""
    problem: str
    own_key: str = ""
    """That of its result, where the columns of its row are damaged, perhaps `key` too."""

    @property
    def name(self) -> str:
        """The cell for people."""
        return f"the cell with key {self.key}" if self.cell is None else f"{self.cell.name} {self.cell.budget}"


class Verified(NamedTuple):
    """What was found."""

    rows: int
    """That were looked at."""
    files: int
    """That have the checksum that was recorded."""
    structure: tuple[str, ...]
    """What SQLite says of the ledger's own structure."""
    damages: tuple[Damage, ...]
    marked: int
    """Cells that are to be measured again by the next run."""
    strays: tuple[str, ...] = ()
    """Files of traces and policies, within the folder, of which neither a row nor the plan knows: rows may be lost."""

    @property
    def is_whole(self) -> bool:
        """Nothing is damaged or missing."""
        return not (self.structure or self.damages or self.strays)


def verify(folder: Path) -> Verified:
    """Look at all that is recorded in a folder; nothing is written.

    Raises:
        UsageError: there are no results, or the ledger cannot be opened at all.
    """
    if (file := stored.locate(folder)) is not None and file.name == stored.LINES:
        return Verified(sum(1 for _ in stored.read(folder)), 0, (), (), 0)
    with Ledger(folder / FILE, create=False) as ledger:
        damages = [Damage(key, cell, "row", _LOST) for key, cell in ledger.lost().items()]
        checked = [_looked_at(folder, each) for each in ledger.recorded()]
        damages += [damage for one in checked for damage in one.damages]
        sound = not any(damage.what == "row" for damage in damages)  # else a row may have another key
        return Verified(
            rows=len(checked),
            files=sum(one.files for one in checked),
            structure=tuple(ledger.problems()),
            damages=tuple(damages),
            marked=sum(one.again for one in checked),
            strays=tuple(_strays(folder, {*(row.key for row in ledger.listed()), *ledger.planned()})) if sound else (),
        )


def _strays(folder: Path, keys: Iterable[str]) -> Iterator[str]:
    """A name ends in the beginning of a key. Of a cell that was interrupted the plan has the key."""
    known = {end_of_name(key) for key in keys}
    lengths = {len(end) for end in known}
    for kind in (TRACES, POLICIES):
        for path in sorted((folder / kind).glob("*.npz")):
            if not any(path.name[-length:] in known for length in lengths):
                yield f"{kind}/{one_line(path.name)}"


class _Found(NamedTuple):
    """Of one row."""

    damages: tuple[Damage, ...]
    files: int
    again: bool


def _looked_at(folder: Path, row: Recorded) -> _Found:
    if isinstance(row.result, str):
        return _Found((Damage(row.key, row.cell, "row", row.result, row.own_key),), 0, row.again)
    damages = tuple(_changed(folder, row.files, row.result))
    return _Found(damages, len(row.files) - len(damages), row.again)


def _changed(folder: Path, checksums: Mapping[str, str], result: Result) -> Iterator[Damage]:
    paths, there = cell_files(folder, result.id, result.key), checksums_beside(folder, result)
    for what, path in (("traces", paths.traces), ("policies", paths.policies)):
        if what in checksums and there.get(what) != checksums[what]:
            problem = "is not as it was recorded" if what in there else "is missing"
            yield Damage(result.key, result.id, what, f"{path} {problem}")


# ------------------------------------------------------------------------------------------------------------- repair


def repair(folder: Path) -> Verified:
    """Mark the cells of which something is damaged or missing, so that the next run measures them again.

    Their results stay until then. A ledger with a damaged structure is written anew, with all that can be read; the old
    one stays beside it. Returns what was found.

    Raises:
        UsageError: as `verify`; or another process writes in the folder, or it cannot be written.
    """
    with writing(folder):
        checked = verify(folder)
        if checked.structure:
            _write_anew(folder / FILE)
        if checked.damages:
            with Ledger(folder / FILE) as ledger:
                for damage in checked.damages:
                    ledger.mark(damage.key, damage.own_key or damage.key)
    return checked


def _write_anew(path: Path) -> None:
    new, damaged = (inside(path.with_name(name), path.parent) for name in (f"{path.name}.new", DAMAGED))
    try:
        new.unlink(missing_ok=True)
        with Ledger(path, create=False) as source, Ledger(new) as target:
            target.copy(source)
        if not damaged.exists():
            shutil.copyfile(path, damaged)
        new.replace(path)
    except OSError as error:
        raise unwritable(f"cannot write {new}", error) from error
