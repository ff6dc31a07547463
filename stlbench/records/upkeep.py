"""The upkeep of folders of results: checked by their checksums, cells taken out, folders put together."""

import os
import re
import shutil
import warnings
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple, get_args

from stlbench.errors import UsageError, did_you_mean, one_line
from stlbench.records import array_files, result_files, results_folder
from stlbench.records.identity import OUTSIDE, CellId
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.lines import entries, is_lines, write_lines
from stlbench.records.result import ACCIDENTS, NOT_RUN, Result, Status
from stlbench.records.result_files import LINES
from stlbench.records.rows import LedgerWarning, checksums_beside
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
    """Files of traces, policies and trainings in the folder without a row and a plan: rows may be lost."""
    lines: str = ""
    """What is wrong with `cells.jsonl`, which takes the place of a ledger that is lost; empty if nothing is."""

    @property
    def is_whole(self) -> bool:
        return not (self.structure or self.damages or self.strays or self.lines)


def verify(folder: Path) -> Verified:
    """Check all that is recorded in a folder; nothing is written. Raises `UsageError` without results."""
    file = results_folder.locate(folder) or folder / LEDGER
    folder = results_folder.folder_of(folder)
    if is_lines(file):
        return _verify_lines(file, folder)
    with Ledger(file, create=False) as ledger:
        if problems := ledger.problems():
            return Verified(0, 0, tuple(problems), (), 0)
        damages, there, rows, files, marked = list[Damage](), set[str](), 0, 0, 0
        for row in ledger.inspected():
            rows, marked = rows + 1, marked + row.again
            there.update((row.key, row.own_key))
            if isinstance(row.result, str):
                damages.append(Damage(row.key, row.cell, "row", row.result, row.own_key))
            else:
                changed = list(_changed(folder, row.files, row.result))
                damages += changed
                files += len(row.files.keys() - {damage.what for damage in changed})
        sound = not any(damage.what == "row" for damage in damages)  # else a row may have another key
        gone = {key: cell for key, cell in ledger.recorded().items() if key not in there}
        damages += [Damage(key, cell, "row", "it was recorded, and is not there") for key, cell in gone.items()]
        keys = {*(row.key for row in ledger.listed()), *ledger.planned(), *gone}
        return Verified(
            rows=rows,
            files=files,
            structure=(),
            damages=tuple(damages),
            marked=marked,
            strays=tuple(_strays(folder, keys)) if sound else (),
            lines=_unreadable(folder / LINES),
        )


def _unreadable(file: Path) -> str:
    """Why lines cannot be read; empty if they can, or there are none."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LedgerWarning)  # the next run mends a line that was cut
        try:
            for _ in entries(file) if os.path.lexists(file) else ():
                pass
        except UsageError as error:
            return one_line(error)
    return ""


def _verify_lines(file: Path, folder: Path) -> Verified:
    """Lines have the hashes of policies, and nothing of traces. A file that is not there was left out."""
    rows, files, damages = 0, 0, list[Damage]()
    for result in results_folder.read(file):
        rows += 1
        path = result_files.cell_files(folder, result.id, result.key).policies
        if not (_stores_policies(result) and os.path.lexists(path)):
            continue
        if problem := _wrong_policies(folder, result):
            damages.append(Damage(result.key, result.id, "policies", problem))
        else:
            files += 1
    return Verified(rows, files, (), tuple(damages), 0)


def _strays(folder: Path, keys: Iterable[str]) -> Iterator[str]:
    """A name ends in the beginning of a key. The plan has the key of a cell that was interrupted."""
    known = {result_files.end_of_name(key) for key in keys}
    lengths = {len(end) for end in known}
    for kind in (result_files.TRACES, result_files.POLICIES, result_files.TRAININGS):
        for name in result_files.names(folder / kind, folder, ".npz"):
            if not any(name[-length:] in known for length in lengths):
                yield f"{kind}/{one_line(name)}"


def _changed(folder: Path, checksums: Mapping[str, str], result: Result) -> Iterator[Damage]:
    paths, there = result_files.cell_files(folder, result.id, result.key), checksums_beside(folder, result)
    for what, path in (("traces", paths.traces), ("policies", paths.policies)):
        if what in checksums and there.get(what) != checksums[what]:
            lacking = "is a link, or no file" if os.path.lexists(path) else "is missing"
            problem = "is not as it was recorded" if what in there else lacking
            yield Damage(result.key, result.id, what, f"{path} {problem}")
        elif what == "policies" and (problem := _wrong_policies(folder, result)):
            yield Damage(result.key, result.id, what, problem)


def _stores_policies(result: Result) -> bool:
    return result.measurement is not None and result.measurement.policies is not None


def _wrong_policies(folder: Path, result: Result) -> str:
    """What is wrong with a result's policies by the hashes in it; empty if nothing is.

    A checksum alone may be of a file that was damaged before a merge or a new ledger.
    """
    try:
        if _stores_policies(result):
            array_files.check_policies(folder, result)
    except (ValueError, OSError) as error:
        return one_line(error)
    return ""


def repair(folder: Path) -> Verified:
    """Mark the cells with a damaged or missing part, so that the next run measures them; what was damaged.

    Their results stay until then. Lines that cannot be read are written anew, unless a row is damaged, as they may have
    its result. Raises `UsageError` if the structure of the ledger is damaged, or there is none.
    """
    results_folder.refuse_lines(folder, "take damaged files from where they came")
    Ledger(folder / LEDGER, create=False).close()  # else the lock would make a folder that the user mistyped
    with result_files.writing(folder):
        checked = verify(folder)
        if checked.structure:
            raise UsageError(f"the ledger {folder / LEDGER} is damaged; {way_out(folder / LEDGER)}")
        if checked.damages:
            with Ledger(folder / LEDGER) as ledger:
                for damage in checked.damages:
                    ledger.mark(damage.key, damage.own_key or damage.key)
        if checked.lines and not any(damage.what == "row" for damage in checked.damages):
            write_lines(results_folder.read(folder), folder / LINES, results_folder.missing(folder))
    return checked


def choose(
    folder: Path,
    names: Collection[str] | None = None,
    statuses: Collection[str] | None = None,
    budget: str | None = None,
) -> dict[CellId, str]:
    """The cells in a folder's ledger that meet all conditions, with their statuses; in names, `*` stands for any
    characters. A cell without a result is among them if its setting has none: beside other seeds it stays planned.

    Raises `UsageError` if there is no condition or no ledger, or a name or status fits no cell.
    """
    if not (names or statuses or budget):
        raise UsageError("which cells? Name them, or say --status or --budget")
    for status in statuses or ():
        if status not in (known := (*get_args(Status), NOT_RUN)):
            raise UsageError(f"no status '{status}'{did_you_mean(status, known)}")
    with Ledger(folder / LEDGER, create=False) as ledger:
        cells: dict[CellId, str] = {result.id: result.status for result in ledger.results()}
        measured = {cell.setting for cell in ledger.present()}
        cells |= {cell: NOT_RUN for cell in ledger.missing() if cell.setting not in measured}
    if names:
        fitting = [_pattern(name, {cell.name for cell in cells}) for name in names]
        cells = {cell: status for cell, status in cells.items() if any(one.fullmatch(cell.name) for one in fitting)}
    chosen = {
        cell: status
        for cell, status in cells.items()
        if (not statuses or status in statuses) and budget in (None, cell.budget)
    }
    if not chosen:
        raise UsageError(f"no such cell in {folder / LEDGER}")
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
    with result_files.writing(folder), Ledger(folder / LEDGER, create=False) as ledger:
        keys = ledger.counted()
        staying = {cell.setting for cell in keys.keys() - cells if cell.track != OUTSIDE}
        leaving = {cell.setting for cell in cells if cell in keys} - staying
        for cell in {*cells, *(cell for cell in ledger.planned().values() if cell.setting in leaving)}:
            take_out(folder, ledger, cell)
        ledger.plan_also({keys[cell]: cell for cell in cells if cell in keys and cell.setting in staying})


def take_out(folder: Path, ledger: Ledger, cell: CellId) -> None:
    """Take one cell out, for what writes in the folder already."""
    _discard(folder, cell, ledger.remove(cell))


def replace(folder: Path, ledger: Ledger, result: Result, *, again: bool = False) -> None:
    """Record a result whose files are there, in place of all others of its cell, for what writes in the folder already.

    The old files go last, so that an interruption loses no result.
    """
    keys = ledger.replace(result, again=again)
    _discard(folder, result.id, keys, result_files.cell_files(folder, result.id, result.key))


def _discard(folder: Path, cell: CellId, keys: Iterable[str], staying: Collection[Path] = ()) -> None:
    for key in keys:
        for file in result_files.cell_files(folder, cell, key):
            if file not in staying:
                result_files.inside(file, folder).unlink(missing_ok=True)


class Merged(NamedTuple):
    """The outcome of a merge, in numbers of cells."""

    added: int  # cells that the folder did not have
    replaced: int  # cells whose result was older, or a failure
    kept: int  # not copied: the folder has a newer result, or one that is no failure
    planned: int  # cells without a result in either folder
    conflicts: tuple[str, ...]  # names of cells with equal keys and different scores: one of the two results stays
    damaged: tuple[str, ...]  # files that differ from their checksums; they were not copied
    other_code: int = 0  # cells of which the folders have results with different keys


def merge(into: Path, source: Path) -> Merged:
    """Copy the results of `source` into the ledger of `into`, their traces, policies and logs, and its plan.

    If both have a result of a cell, one that is no failure stays, else one whose key `into` has planned, else one
    without damaged files, else the one whose run began later, else that of `into`. A sound result of the source also
    replaces one that lacks its policies. The marks of `repair` are copied. An interrupted merge can be repeated. Raises
    as `refuse_merging`.
    """
    refuse_merging(into, source)
    incoming = list(results_folder.read(source))
    home, damages = results_folder.folder_of(source), verify(source).damages
    damaged = {(damage.key, damage.what) for damage in damages}
    broken, marked = {damage.key for damage in damages if _is_left(home, damage)}, _marked(source)
    counts, conflicts, left_out = Counter[str](), list[str](), list[str]()
    with result_files.writing(into), Ledger(into / LEDGER) as ledger:
        present, keys = {result.id: result for result in ledger.results()}, ledger.planned().keys()
        both = any(result.id in present for result in incoming)  # else no file of `into` need be read
        found = verify(into).damages if both else ()
        lacking = {damage.key for damage in found if damage.what == "policies" or _is_left(into, damage)}
        for result in incoming:
            before = present.get(result.id)
            left_out += _left_out(home, result, damaged)
            conflicts += [] if before is None or _agree(result, before) else [result.id.name]
            if before is not None:
                counts["other code"] += result.key != before.key
                mends = before.key in lacking and _has_policies(home, result)
                if not _is_better(result, before, keys, (result.key not in broken, not mends)):
                    counts["kept"] += 1
                    continue
            _copy_files(home, into, result, damaged)
            if before is None:
                ledger.record(result, again=result.key in marked)
            else:
                replace(into, ledger, result, again=result.key in marked)
            counts["added" if before is None else "replaced"] += 1
        planned = _plan(source, ledger)
    numbers = counts["added"], counts["replaced"], counts["kept"], planned
    return Merged(*numbers, tuple(conflicts), tuple(left_out), counts["other code"])


def refuse_merging(into: Path, source: Path) -> None:
    """Raises `UsageError` if `source` has no results, or is `into` itself, or `into` is a file or has no ledger."""
    if into.resolve() == results_folder.folder_of(source).resolve():
        raise UsageError(f"{source} cannot be merged into itself")
    results_folder.existing(source)
    results_folder.refuse_lines(into, "merge into a new folder, and export that")


def _marked(source: Path) -> set[str]:
    """The keys of results in whose place the next run measures the cell; lines say of none."""
    if is_lines(file := results_folder.existing(source)):
        return set()
    with Ledger(file, create=False) as ledger:
        return {row.key for row in ledger.listed() if row.again}


def _is_left(folder: Path, damage: Damage) -> bool:
    """Whether what is damaged is there. Files may be deleted to save space."""
    if damage.cell is None or damage.what == "row":
        return True
    return os.path.lexists(result_files.cell_files(folder, damage.cell, damage.key)._asdict()[damage.what])


def _has_policies(folder: Path, result: Result) -> bool:
    """Whether a folder has all policies that a result has recorded."""
    path = result_files.cell_files(folder, result.id, result.key).policies
    return not _stores_policies(result) or result_files.is_there(path, folder)


def _is_better(result: Result, before: Result, planned: Collection[str], whole: tuple[bool, bool]) -> bool:
    """No failure is better than a failure, then a key that was planned, then what is `whole`, then the later run.

    A result of older code may be the later one, and no run would count it. Times are in UTC, so that texts compare as
    times do.
    """

    def rank(one: Result, is_whole: bool) -> tuple[bool, bool, bool, str]:
        return one.status not in ACCIDENTS, one.key in planned, is_whole, one.provenance.get("time", "")

    return rank(result, whole[0]) > rank(before, whole[1])


def _agree(result: Result, before: Result) -> bool:
    """Whether two results of one key have the same scores; times may differ."""
    one, other = result.measurement, before.measurement
    if result.key != before.key or one is None or other is None:
        return True
    return (one.selected, one.final) == (other.selected, other.final)


def _plan(source: Path, ledger: Ledger) -> int:
    """Take over the missing cells of the source's plan; the number of cells that are new to the ledger."""
    known = {*ledger.counted(), *ledger.planned().values()}
    new = {key: cell for key, cell in results_folder.missing(source).items() if cell not in known}
    ledger.plan_also(new)
    return len(new)


def _left_out(source: Path, result: Result, damaged: Collection[tuple[str, str]]) -> list[str]:
    files = result_files.cell_files(source, result.id, result.key)._asdict()
    return [str(file) for kind, file in files.items() if (result.key, kind) in damaged and os.path.lexists(file)]


def _copy_files(source: Path, into: Path, result: Result, damaged: Collection[tuple[str, str]]) -> None:
    cell = result.id, result.key
    here, there = (result_files.cell_files(folder, *cell)._asdict() for folder in (source, into))
    for kind, recorded in here.items():
        if (result.key, kind) not in damaged and result_files.is_there(recorded, source):
            with result_files.to_read(recorded, source) as content, result_files.opened(there[kind], into) as copy:
                shutil.copyfileobj(content, copy)
        elif kind == "log":  # of a failure before, with the same key
            result_files.inside(there[kind], into).unlink(missing_ok=True)
