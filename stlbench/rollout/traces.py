"""Recorded traces of one task: those of a cell, or of several seeds together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stlbench.contract import Array
from stlbench.errors import UsageError
from stlbench.records.result import Result
from stlbench.records.saved_traces import Film, read_cell
from stlbench.task.task import Task


@dataclass(frozen=True)
class Recording:
    """Traces of one policy, or of several seeds' policies in turn, from the report's starts."""

    traces: Array  # (N, T + 1, k)
    seeds: int
    film: Film | None = None  # of a single cell; None where an older version recorded it

    def evenly(self, count: int) -> Array:
        chosen = np.unique(np.linspace(0, len(self.traces) - 1, count).round().astype(np.int64))
        return self.traces[chosen]


def load(task: Task, result: Result, run: Path) -> Recording:
    """The recording of a finished cell. Raises `UsageError` where it is damaged, missing, or of another version."""
    saved = read_cell(run, result)
    if saved.names != task.signals or saved.samples.shape[1] != task.file.steps + 1:
        raise UsageError(f"the traces of {result.id.name} are of another version of the task {task.name}")
    return Recording(saved.samples, 1, saved.film)


def gather(recordings: Sequence[Recording]) -> Recording:
    return Recording(np.concatenate([recording.traces for recording in recordings]), len(recordings))
