"""A table as text that is ready to be laid out, and how numbers are written in it."""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["NOTHING", "Column", "Table", "decimal"]

NOTHING = "-"
"""What a cell shows where there is nothing to show."""


@dataclass(frozen=True)
class Column:
    """A column: its header with the unit, and how a narrow screen may treat it."""

    title: str
    short: str = ""
    """The header on screen, where it may be shorter."""
    right: bool = True
    """Aligned to the right, as numbers are."""
    drop: int = 0
    """On a narrow screen columns go from the highest number down; 0 always stays. Files have all columns."""
    shared: bool = False
    """On screen, moves into the title where all rows say the same."""
    below: bool = False
    """Long text: on screen it is a line under the table."""

    @property
    def header(self) -> str:
        """The header on screen."""
        return self.short or self.title


@dataclass(frozen=True)
class Table:
    """Text in rows, each as long as `columns`."""

    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()


def decimal(value: float | None, digits: int = 3) -> str:
    """A number with so many decimals, never "-0.000"; NOTHING where there is none."""
    if value is None:
        return NOTHING
    text = f"{value:.{digits}f}"
    return text.removeprefix("-") if math.isfinite(value) and float(text) == 0 else text
