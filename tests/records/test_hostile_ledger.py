"""Ledgers that a stranger made so that reading them runs something, never ends, or takes all memory."""

from __future__ import annotations

import io
import math
import sqlite3
import struct
import warnings
import zipfile
from collections.abc import Sequence
from contextlib import closing, suppress
from pathlib import Path

import numpy as np
import pytest
from helpers.ledgers import say
from helpers.synthetic_results import result

from stlbench.errors import UsageError
from stlbench.records import array_files, lines, results_folder, schema
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.result_files import cell_files
from stlbench.records.rows import LedgerWarning
from stlbench.records.upkeep import merge, remove, repair, verify
from stlbench.study.results import Results

ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT * FROM n"


@pytest.fixture
def ledger(tmp_path: Path) -> Path:
    with Ledger(tmp_path / LEDGER) as made:
        for seed in range(3):
            made.record(result(seed=seed))
        made.plan_also({f"planned-{seed}": result(seed=seed).id for seed in range(3, 9)})
    return tmp_path / LEDGER


@pytest.mark.parametrize(
    ("statements", "said"),
    [
        (["ALTER TABLE cells RENAME TO other", f"CREATE VIEW cells AS {ENDLESS}"], "has the table 'other'"),
        (["DROP TABLE planned", f"CREATE VIEW planned AS {ENDLESS}"], "has the view 'planned'"),
        (["CREATE TRIGGER t AFTER INSERT ON cells BEGIN DELETE FROM planned; END"], "has the trigger 't'"),
        (["CREATE TABLE more (a)"], "has the table 'more'"),
        (["CREATE INDEX i ON cells (abs(seed))"], "has the index 'i'"),
        (["DROP INDEX listed", "CREATE INDEX listed ON cells (abs(seed))"], "has the index 'listed'"),
        (["ALTER TABLE cells ADD COLUMN slow AS (hex(zeroblob(1000000)))"], "has the column 'slow'"),
        (["ALTER TABLE planned ADD COLUMN [key) SELECT 1 --]"], "has the column"),
        (["DROP TABLE planned", "CREATE VIRTUAL TABLE planned USING fts5(key)"], "has the table 'planned"),
    ],
)
def test_what_stlbench_does_not_write_is_refused(ledger: Path, statements: Sequence[str], said: str) -> None:
    say(ledger, *statements)
    for read in (Results.load, verify, repair, lambda folder: list(results_folder.read(folder))):
        with pytest.raises(UsageError, match=said):
            read(ledger.parent)
    with pytest.raises(UsageError, match=said), Ledger(ledger) as written:
        written.record(result(seed=9))


def test_a_value_that_is_too_long_is_named_and_the_others_are_read(
    ledger: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(schema, "LONGEST", 100_000)
    say(ledger, "UPDATE cells SET result = zeroblob(100001) WHERE seed = 1")
    with pytest.warns(LedgerWarning, match="too big"):
        assert [each.id.seed for each in results_folder.read(ledger.parent)] == [0, 2]
    (damage,) = verify(ledger.parent).damages
    assert (damage.what, damage.problem) == ("row", "string or blob too big")


@pytest.mark.parametrize("table", ["planned", "cells", "listed", "sqlite_autoindex_cells_1"])
def test_pages_that_point_to_pages_for_ever_come_to_an_end(ledger: Path, table: str) -> None:
    endless(ledger, table)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LedgerWarning)
        for read in (Results.load, verify, lambda folder: list(results_folder.read(folder)), results_folder.missing):
            with suppress(UsageError):
                read(ledger.parent)


def test_nor_does_a_schema_go_on_for_ever(ledger: Path) -> None:
    endless(ledger, "sqlite_schema")
    with pytest.raises(UsageError, match=r"cannot (open|read) the ledger"):
        Results.load(ledger.parent)


@pytest.mark.parametrize("files", ["[" * 200_000, '"traces"', "[1]"])
def test_checksums_that_are_none_are_damage_of_their_row(ledger: Path, files: str) -> None:
    say(ledger, "UPDATE cells SET files = ? WHERE seed = 1", values=(files,))
    (damage,) = verify(ledger.parent).damages
    assert (damage.what, damage.cell) == ("row", result(seed=1).id)


def test_a_line_that_goes_on_for_ever_is_one_line_of_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "cells.jsonl"
    path.write_text('{"status": "not run", "a": ' + "[" * 200_000)
    with pytest.raises(UsageError, match=r"line 1: .*too deep to read"):
        Results.load(tmp_path)
    monkeypatch.setattr(lines, "LONGEST", 100_000)
    with pytest.raises(UsageError, match="line 1: it has more than"):
        Results.load(tmp_path)


def test_an_archive_that_unpacks_to_all_memory_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    array_files.write_arrays(tmp_path / "a.npz", {"traces": np.zeros((1000, 100, 2)), "signals": np.array(["x", "y"])})
    monkeypatch.setattr(array_files, "LARGEST", 2**20)
    with pytest.raises(UsageError, match="its arrays would take 1 MiB, at most 1 are read"):
        array_files.read_saved(tmp_path / "a.npz")


def test_files_of_which_an_emptied_ledger_says_nothing_are_named(ledger: Path) -> None:
    say(ledger, "DELETE FROM cells")
    with Ledger(ledger, create=False) as opened:
        planned = next(iter(opened.planned()))
    for key in ("0" * 32, planned):  # a cell that was planned was interrupted, and comes to be measured again
        array_files.write_arrays(cell_files(ledger.parent, result().id, key).traces, {"a": np.zeros(1)})
    found = verify(ledger.parent)
    assert found.strays == ("traces/hold-disc_funnel_dqn_0_000000000000.npz",)
    assert not found.is_whole
    array_files.write_arrays(cell_files(ledger.parent, result().id, "1" * 32).training, {"a": np.zeros(1)})
    assert verify(ledger.parent).strays == (*found.strays, "trainings/hold-disc_funnel_dqn_0_111111111111.npz")


def endless(path: Path, name: str, levels: int = 12, width: int = 60) -> None:
    """Put pages between a b-tree's root and its content, each of which points to the next one many times."""
    with closing(sqlite3.connect(path)) as database:
        ((size,),) = database.execute("PRAGMA page_size")
        found = database.execute("SELECT rootpage FROM sqlite_schema WHERE name = ?", (name,)).fetchall()
    ((root,),) = found or [(1,)]  # that of the schema itself
    pages, begin = bytearray(path.read_bytes()), 100 if root == 1 else 0
    first = len(pages) // size + 1
    at = (root - 1) * size
    leaf = bytes(begin) + bytes(pages[at + begin : at + size])
    is_index = leaf[begin] in (2, 10)
    moved = leaf[begin : begin + 8] + leaf[begin + 8 :]
    if begin:  # the first page has a header that others lack; its cells stay where they are
        count = struct.unpack(">H", leaf[begin + 3 : begin + 5])[0]
        moved = leaf[begin : begin + 8 + 2 * count]
        moved += bytes(leaf[len(moved) :][: size - len(moved)])
    for level in range(levels):
        pages += interior(first + level + 1, size, width, is_index=is_index)
    pages += moved.ljust(size, b"\0")[:size]
    pages[at + begin : at + size] = interior(first, size, width // 2, is_index=is_index, begin=begin)
    pages[28:32] = struct.pack(">I", len(pages) // size)
    path.write_bytes(pages)


def interior(child: int, size: int, width: int, *, is_index: bool, begin: int = 0) -> bytes:
    """A page with the same child many times; that of an index has an empty record in each cell."""
    cell = struct.pack(">I", child) + (b"\x02\x02\x00" if is_index else b"\x01")
    start = size - width * len(cell)
    head = struct.pack(">BHHHBI", 2 if is_index else 5, 0, width, start, 0, child)
    slots = b"".join(struct.pack(">H", start + number * len(cell)) for number in range(width))
    return (head + slots).ljust(start - begin, b"\0") + cell * width


@pytest.mark.filterwarnings("ignore::stlbench.records.rows.LedgerWarning")
@pytest.mark.parametrize("key", [b"\x00ab", None])
def test_keys_that_are_no_text_are_passed_over(ledger: Path, tmp_path: Path, key: bytes | None) -> None:
    columns = "?, task, method, agent, 77, budget, track FROM cells LIMIT 1"
    say(ledger, *(f"INSERT INTO {table} SELECT {columns}" for table in ("planned", "recorded")), values=(key,))
    assert verify(ledger.parent).rows == 3
    assert lines.text_of([], results_folder.missing(ledger.parent)).count("\n") == 6
    assert merge(tmp_path / "merged", ledger.parent).planned == 6
    remove(ledger.parent, [result(seed=77).id])
    assert repair(ledger.parent).rows == 3


@pytest.mark.parametrize("shape", [(1, 2**18, 1), (1, 100, 1)])
def test_a_shape_that_is_negative_hides_no_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shape: tuple[int, ...]
) -> None:
    """An archive whose second array takes back what the first one takes."""
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        for name, said in (("traces", shape), ("zz", (-(10**12),))):
            head = io.BytesIO()
            np.lib.format.write_array_header_1_0(head, {"descr": "|i1", "fortran_order": False, "shape": said})
            archive.writestr(f"{name}.npy", head.getvalue() + bytes(max(0, math.prod(said))))
    monkeypatch.setattr(array_files, "LARGEST", 2**20)
    if shape[1] > 2**17:
        with pytest.raises(UsageError, match="its arrays would take 2 MiB, at most 1 are read"):
            array_files.read_arrays(tmp_path / "a.npz", "traces")
    assert array_files.size_as_floats(tmp_path / "a.npz") > 8 * math.prod(shape)


def test_of_a_header_no_more_is_read_than_a_header_has(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("traces.npy", b"\x93NUMPY\x02\x00" + (2**22).to_bytes(4, "little") + b" " * 2**22)
    taken, plain = list[int](), zipfile.ZipExtFile.read
    monkeypatch.setattr(zipfile.ZipExtFile, "read", lambda file, n=-1: taken.append(n) or plain(file, n))
    with pytest.raises(ValueError, match="header"):
        array_files.read_arrays(tmp_path / "a.npz")
    assert taken == [2**16]
