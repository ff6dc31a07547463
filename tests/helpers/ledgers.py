"""Ledgers that are changed behind stlbench's back."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any


def say(path: Path, *statements: str, values: tuple[Any, ...] = ()) -> None:
    """Run statements of SQL in the file of a ledger, each with the same values in the places of its `?`."""
    with closing(sqlite3.connect(path, isolation_level=None)) as database:
        for statement in statements:
            database.execute(statement, values)
