"""Amounts of memory: as a user writes them, as a person reads them, and what a machine has."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import psutil
from pydantic import BeforeValidator, Field

_GROUPS = Path("/sys/fs/cgroup")  # where Linux says what a container, or a job of a cluster, may take
_SHARE = 0.9  # of the machine's memory, for all cells together by default

_AMOUNT = re.compile(r"([0-9]+(?:\.[0-9]+)?) *([KMGT])(?:i?B)?", re.IGNORECASE)


def _read(value: Any) -> Any:
    """4G means 4 GiB, as for most programs. A number is one of bytes."""
    if not isinstance(value, str):
        return value
    match = _AMOUNT.fullmatch(value.strip())
    if match is None:
        raise ValueError("should be an amount of memory, as in 4G, 512M or 1.5GiB")
    return int(float(match[1]) * 1024 ** (1 + "KMGT".index(match[2].upper())))


Memory = Annotated[int, BeforeValidator(_read), Field(ge=2**20)]  # bytes, written as 4G, 512M or 1.5GiB


def share(jobs: int) -> int:
    """The default number of bytes for each of `jobs` cells at a time."""
    return int(_SHARE * min([psutil.virtual_memory().total, *allowed(_GROUPS, _own_groups())]) / jobs)


def allowed(root: Path, own: str) -> list[int]:
    """The limits in bytes of control groups below `root`: of those in `own`, as in /proc/self/cgroup, and above."""
    limits = list[int]()
    for line in own.splitlines():
        _, kinds, path = line.split(":", 2)
        if kinds in ("", "memory"):
            top, name = (root / "memory", "memory.limit_in_bytes") if kinds else (root, "memory.max")
            group = top / path.lstrip("/")
            for folder in (group, *(above for above in group.parents if above.is_relative_to(top))):
                with suppress(OSError, ValueError):  # "max" is no limit
                    limits.append(int((folder / name).read_text()))
    return limits


def _own_groups() -> str:
    with suppress(OSError):
        return Path("/proc/self/cgroup").read_text()
    return ""


def text_of(size: int) -> str:
    return f"{size / 2**30:.1f} GiB" if size >= 2**30 else f"{size / 2**20:.0f} MiB"
