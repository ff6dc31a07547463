"""What might explain a result without being part of its key: versions, machine, jobs beside it, time."""

from __future__ import annotations

import os
import platform
from datetime import UTC, datetime
from importlib import metadata

__all__ = ["collect"]

PACKAGES = ("numba", "numpy", "scipy", "stable-baselines3", "stlbench", "torch")


def collect(jobs: int) -> dict[str, str]:
    """The provenance of cells that start now, `jobs` of them at a time. Imports none of the packages it names."""
    return {
        "python": platform.python_version(),
        **{name: _version(name) for name in PACKAGES},
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} CPUs",
        "jobs": str(jobs),
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _version(distribution: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "not installed"
