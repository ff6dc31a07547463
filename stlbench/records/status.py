"""How a cell can end, and which of these ends are accidents."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal

from stlbench.errors import UsageError, did_you_mean

Status = Literal["done", "raised", "timeout", "killed", "intractable", "unsuitable"]
"""How a cell ended. `intractable` and `unsuitable` are findings about a method; the three before them are accidents."""
NOT_RUN: Literal["not run"] = "not run"
"""In tables, in the place of a status: the cell was planned and has no result."""
ACCIDENTS: tuple[Status, ...] = ("raised", "timeout", "killed")
"""The statuses that a retry may run."""
FAILED = "failed"
"""The word for all accidents."""


def accidents_of(value: object) -> tuple[Status, ...]:
    """The accidents that a retry runs: a comma list or the words themselves; `failed` and True are all of them.

    Raises:
        UsageError: one of them is no accident.
    """
    if value is None or isinstance(value, bool):
        return ACCIDENTS if value else ()
    words: list[object] = [value]
    if isinstance(value, str):
        words = list(value.split(","))
    elif isinstance(value, Iterable) and not isinstance(value, Mapping):
        words = list(value)
    given = [str(word).strip() for word in words]
    for word in given:
        if word not in (*ACCIDENTS, FAILED):
            raise UsageError(f"no failure '{word}'{did_you_mean(word, (*ACCIDENTS, FAILED))}")
    return tuple(status for status in ACCIDENTS if status in given or FAILED in given)
