"""Notes that several tables of a page have: they are said once, and each of these tables has a link to them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from stlbench.report.page.listed import Listed


@dataclass(frozen=True)
class Said:
    """What is said of tables of one kind."""

    key: str
    """Name of its place on the page."""
    title: str
    """Of these tables, without what their rows share."""
    notes: tuple[str, ...]


def said_once(tables: Iterable[Listed]) -> dict[tuple[str, ...], Said]:
    """For notes that more than one of the tables has, where on the page they stand."""
    kept = [table for table in tables if table.notes]
    counts, found = Counter(table.notes for table in kept), dict[tuple[str, ...], Said]()
    for table in kept:
        if counts[table.notes] > 1 and table.notes not in found:
            found[table.notes] = Said(f"notes-{len(found)}", table.title.partition(":")[0], table.notes)
    return found
