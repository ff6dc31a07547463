"""A cell as it is planned: what is run, and the code that its key stands for."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from stlbench.records.identity import CellId
from stlbench.records.result import Measurement, Result
from stlbench.records.status import Status
from stlbench.registry import folders
from stlbench.registry.fingerprint import Code
from stlbench.study.tracks import Recipe, task_of
from stlbench.task.task import Task


@dataclass(frozen=True)
class Cell:
    """One training run and its evaluation."""

    id: CellId
    key: str
    """Hash (32 hex digits) of all that can change the result, and of nothing else."""
    deadline: float
    """Wall seconds after which it is stopped."""
    recipe: Recipe | None = None
    """That of its method, on the track `tuned`."""
    folder: Path | None = None
    """Where its task is, for a task that is a folder."""
    parts: tuple[tuple[str, str], ...] = field(default=(), repr=False)
    """Name and hash of each part of the key but the track and the seed, as `keys.PARTS` names them."""
    code: tuple[Code, ...] = field(default=(), repr=False)
    """Of the harness, the task, the method and the agent, as it was when the key was made."""

    def load_task(self) -> Task:
        """The task as the cell's track and recipe have it. Raises `UsageError` where it is not installed."""
        if self.folder is not None:
            folders.know(self.folder)  # this process may be another than the one in which the user named the folder
        return task_of(self.id, self.recipe)

    def ended(
        self, status: Status, reason: str = "", details: str = "", measurement: Measurement | None = None
    ) -> Result:
        """The result of this cell, without provenance."""
        return Result(self.id, self.key, status, reason, details, measurement)


def digest(parts: Iterable[object]) -> str:
    """A hash (32 hex digits) of values that JSON has."""
    # Keys are not sorted: the order of signals, of states and of action axes has a meaning.
    return hashlib.sha256(json.dumps(list(parts)).encode()).hexdigest()[:32]


def derive_seed(*parts: str | int) -> int:
    """A seed in 0..2^63-1 from what it is for: derive_seed("starts", "hold-disc", 3).

    Leave the method out of the parts, and every method gets the same random numbers: comparisons are paired.
    """
    return int.from_bytes(hashlib.sha256(json.dumps(parts).encode()).digest()[:8], "big") >> 1
