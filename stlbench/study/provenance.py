"""Facts that might explain a result without being part of its key: versions, machine, jobs beside it, time."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from stlbench.registry.fingerprint import version_of

if TYPE_CHECKING:
    from stlbench.study.cell import Cell

CODE = "code"
"""Beside them: of which code a cell is, as the first digits of the hash of each part of its key (`cell.PARTS`)."""
PACKAGES = ("gymnasium", "mujoco", "numba", "numpy", "scipy", "stable-baselines3", "stlbench-rl", "torch")


def collect(jobs: int) -> dict[str, str]:
    """The provenance of cells that start now on this machine, `jobs` of them at a time."""
    began = datetime.now(UTC).isoformat(timespec="seconds")
    return {**here(), "jobs": str(jobs or "as many as there were places"), "time": began}


@cache
def here() -> dict[str, str]:
    """The facts of this machine. Imports none of the packages that it names."""
    return {
        "python": platform.python_version(),
        **{name: version_of(name) for name in PACKAGES},
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} CPUs, {_processor()}",
    }


def elsewhere(provenance: Mapping[str, str], facts: Mapping[str, str]) -> dict[str, str]:
    """The provenance of a cell of the same run on another machine, whose `here` gave these facts."""
    return {**facts, **{name: text for name, text in provenance.items() if name not in here()}}


def of_cell(cell: Cell) -> dict[str, str]:
    """The code and the task folder of one cell, for its provenance."""
    from stlbench.records.result import TASK_FOLDER  # it imports NumPy, before which `here` is asked

    code = ", ".join(f"{name} {text[:8]}" for name, text in cell.parts)
    place = {} if cell.folder is None else {TASK_FOLDER: str(cell.folder)}
    return ({CODE: code} if code else {}) | place


def code_of(provenance: Mapping[str, str]) -> dict[str, str]:
    """Part of a key -> the first digits of its hash, from the provenance of a result; empty if it has none."""
    pairs = (part.split(" ") for part in provenance.get(CODE, "").split(", "))
    return {pair[0]: pair[1] for pair in pairs if len(pair) == 2}


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or "unknown processor")
