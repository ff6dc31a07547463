"""Amounts of memory: as a user writes them, as a person reads them, and what a machine has."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import psutil
from pydantic import BeforeValidator, Field

__all__ = ["Memory", "share", "text_of"]

_GROUPS = (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"))
"""Where Linux says what a container may take; the two versions of control groups."""

_OURS = 0.9
"""Of the machine's memory, that cells may take together by default."""


_AMOUNT = re.compile(r"([0-9]+(?:\.[0-9]+)?) *([KMGT])(?:i?B)?", re.IGNORECASE)


def _read(value: Any) -> Any:
    """4G means 4 GiB, as for most programs. A number is one of bytes."""
    if not isinstance(value, str):
        return value
    found = _AMOUNT.fullmatch(value.strip())
    if found is None:
        raise ValueError("should be an amount of memory, as in 4G, 512M or 1.5GiB")
    return int(float(found[1]) * 1024 ** (1 + "KMGT".index(found[2].upper())))


Memory = Annotated[int, BeforeValidator(_read), Field(ge=2**20)]
"""Bytes, written as 4G, 512M or 1.5GiB."""


def share(jobs: int) -> int:
    """Bytes for each of so many cells at a time, where the user does not say."""
    return int(_OURS * min([psutil.virtual_memory().total, *_allowed()]) / jobs)


def _allowed() -> list[int]:
    found = list[int]()
    for path in _GROUPS:
        with suppress(OSError, ValueError):  # "max" is no limit
            found.append(int(path.read_text()))
    return found


def text_of(size: int) -> str:
    """For a person: "4.0 GiB"."""
    return f"{size / 2**30:.1f} GiB" if size >= 2**30 else f"{size / 2**20:.0f} MiB"
