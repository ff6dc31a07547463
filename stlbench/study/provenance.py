"""What might explain a result without being part of its key: versions, machine, jobs beside it, time."""

from __future__ import annotations

import os
import platform
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

__all__ = ["TASK_FOLDER", "collect"]

TASK_FOLDER = "task_folder"
"""Beside these facts, in the cells of a task that is a folder: where it was."""

PACKAGES = ("mujoco", "numba", "numpy", "scipy", "stable-baselines3", "stlbench-rl", "torch")


def collect(jobs: int) -> dict[str, str]:
    """The provenance of cells that start now, `jobs` of them at a time. Imports none of the packages it names."""
    return {
        "python": platform.python_version(),
        **{name: _version(name) for name in PACKAGES},
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} CPUs, {_processor()}",
        "jobs": str(jobs),
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _processor() -> str:
    """The processor's name, which Linux says in a file and `platform` does not."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or "unknown processor")


def _version(distribution: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "not installed"
