"""Tables of CSV that grow row by row, so that a study which is stopped goes on."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any


def rows(table: Path) -> list[dict[str, str]]:
    """The recorded rows; none if there is no table."""
    if not table.is_file():
        return []
    with table.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def add(table: Path, columns: Sequence[str], found: Iterable[Mapping[str, Any]]) -> None:
    """Append rows, below a head. Entries without a column are left out."""
    new = not table.is_file()
    table.parent.mkdir(parents=True, exist_ok=True)
    with table.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, extrasaction="ignore", lineterminator="\n")
        if new:
            writer.writeheader()
        writer.writerows(found)
