"""Snapshots on disk: ledgers, tables of cells, and references.

A *reference* is a folder with `cells.csv`, one row per cell, which is small enough for git and shows in a diff what
changed, and `provenance.json`, which says how it was measured.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping
from dataclasses import fields
from functools import lru_cache
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from stlbench.errors import UsageError, in_words
from stlbench.gate.snapshot import Sample, Snapshot, gather
from stlbench.records import stored
from stlbench.records.identity import IDENTITY, OUTSIDE, CellId
from stlbench.records.ledger import FILE
from stlbench.records.outputs import write
from stlbench.records.schema import is_sqlite
from stlbench.records.status import NOT_RUN
from stlbench.share.checked import unpacked

TABLE, PROVENANCE = "cells.csv", "provenance.json"
NUMBERS = ("robustness_mean", "satisfaction", "training_cpu_seconds", "reward_nanoseconds")
COLUMNS = (*IDENTITY, *(part.name for part in fields(Sample) if part.name != "id"))


def load(path: Path) -> Snapshot:
    """Read a reference, a folder of results, a ledger, a table of cells, or a bundle.

    In a folder of results the ledger, or `cells.jsonl` in its place, goes before the table.

    Raises:
        UsageError: there is nothing of these, or it is not as it should be; the message says where.
    """
    if path.suffix == ".zip":
        return _bundle(path)
    if (path / PROVENANCE).is_file():
        return _reference(path)
    if path.suffix == ".csv":
        return _table(path)
    if (file := stored.locate(path)) is not None:
        return _results(file)
    if (path / TABLE).is_file():
        return _table(path / TABLE)
    if path.is_dir():
        raise UsageError(f"{path} has neither {FILE} nor {TABLE}; `stlbench run` and `stlbench gate` write them")
    return _results(path)


def save(folder: Path, snapshot: Snapshot) -> None:
    """Write a reference. Robustness and satisfaction have all digits, so that equal results are seen to be equal."""
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(COLUMNS)
    for cell in sorted(snapshot.samples):
        values = vars(cell) | vars(snapshot.samples[cell])
        writer.writerow([_text(values[name], name) for name in COLUMNS])
    write(folder / TABLE, table.getvalue())
    write(folder / PROVENANCE, json.dumps(dict(snapshot.provenance), indent=2, ensure_ascii=False) + "\n")


def _text(value: object, column: str) -> str:
    if value is None:
        return ""
    if isinstance(value, float) and math.isfinite(value) and column.endswith("seconds"):
        return f"{value:.4g}"
    return str(value)


def _bundle(path: Path) -> Snapshot:
    with unpacked(path) as (folder, problems):
        if problems:
            raise UsageError(f"{path}: {problems[0]}")
        return _results(folder / stored.LINES)


def _results(path: Path) -> Snapshot:
    if path.is_file() and path.suffix != stored.SUFFIX and not is_sqlite(path):
        raise UsageError(f"{path} is neither a ledger nor a table of cells (.csv)")
    return gather(stored.read(path))


def _reference(folder: Path) -> Snapshot:
    file = folder / PROVENANCE
    try:
        provenance = _adapter(dict[str, str]).validate_json(file.read_bytes())
    except (OSError, ValidationError) as error:
        raise UsageError(f"cannot read {file}: an object of texts is expected") from error
    return Snapshot(_table(folder / TABLE).samples, provenance)


def _table(path: Path) -> Snapshot:
    samples: dict[CellId, Sample] = {}
    try:
        with path.open(newline="", encoding="utf-8") as file:
            for line, row in enumerate(csv.DictReader(file, strict=True), start=2):
                if row.get("status") == NOT_RUN or row.get("track") == OUTSIDE:
                    continue
                sample = _row(row, f"{path}, line {line}")
                if samples.setdefault(sample.id, sample) is not sample:
                    raise UsageError(
                        f"{path}, line {line}: a second row of {sample.id.name}, budget {sample.id.budget}"
                    )
    except (OSError, UnicodeError, csv.Error) as error:
        raise UsageError(f"cannot read {path}: {error}") from error
    return Snapshot(samples)


def _row(row: Mapping[str, str | None], where: str) -> Sample:
    missing = [name for name in (*IDENTITY, "status", *NUMBERS) if name != "track" and row.get(name) is None]
    if missing:
        raise UsageError(f"{where}: no column {', '.join(missing)}; expected are {', '.join(COLUMNS)}")
    texts = {name: row.get(name) or "" for name in COLUMNS}
    cell = {name: texts[name] for name in IDENTITY if texts[name] or name != "track"}  # older tables have no tracks
    rest = {name: text for name, text in texts.items() if name not in IDENTITY and (text or name == "reason")}
    try:
        sample: Sample = _adapter(Sample).validate_python({"id": cell, **rest})
    except ValidationError as error:
        first = error.errors()[0]
        name = next(str(part) for part in first["loc"] if part != "id")
        raise UsageError(f"{where}: {name} is {texts[name]!r}: {in_words(first['msg'])}") from error
    if sample.status == "done" and any(getattr(sample, name) is None for name in NUMBERS):
        raise UsageError(f"{where}: status is done and one of {', '.join(NUMBERS)} is empty")
    return sample


@lru_cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)
