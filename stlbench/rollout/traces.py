"""What the referee recorded of each finished cell: saved as a file, and read again, alone or for several seeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stlbench.contract import Array, Integers
from stlbench.errors import UsageError
from stlbench.result import MAIN, CellId, Result
from stlbench.rollout.referee import Assessment
from stlbench.rollout.trace_files import DAMAGED
from stlbench.task.task import Task

__all__ = ["FOLDER", "Film", "Recording", "gather", "load", "save", "trace_file"]

FOLDER = "traces"
"""Name of the folder of traces in a folder of results."""


@dataclass(frozen=True)
class Film:
    """The states that the best and the worst start of a cell went through."""

    starts: Integers
    """(2,): which starts they are."""
    states: Array
    """(2, decisions + 1, n): at each decision and at the end."""


@dataclass(frozen=True)
class Recording:
    """Traces of one policy, or of several seeds' policies in turn, from the report's starts."""

    traces: Array
    """(N, T + 1, k)."""
    seeds: int
    film: Film | None = None
    """Of a single cell; None where an older version recorded it."""

    def evenly(self, count: int) -> Array:
        """At most `count` of the traces, evenly spread over starts and seeds."""
        chosen = np.unique(np.linspace(0, len(self.traces) - 1, count).round().astype(np.int64))
        return self.traces[chosen]


def load(task: Task, result: Result, run: Path) -> Recording:
    """What was recorded of one finished cell.

    Raises:
        UsageError: there is no file, it is damaged, or it is of another version of the task.
    """
    path = trace_file(run / FOLDER, result.id, result.key)
    try:
        with np.load(path) as saved:
            traces, names = saved["traces"], tuple(saved["signals"].tolist())
            film = Film(saved["extremes"], saved["states"]) if "states" in saved else None
    except FileNotFoundError:
        raise UsageError(
            f"{result.id.name} has no traces at {path}; `stlbench run` records them when it trains a cell"
        ) from None
    except DAMAGED as error:
        raise UsageError(f"cannot read the traces {path}: {str(error)[:200]}") from error
    if names != task.signals or traces.ndim != 3 or traces.shape[1:] != (task.file.steps + 1, len(names)):
        raise UsageError(f"the traces {path} are of another version of the task {task.name}")
    return Recording(traces, 1, film)


def gather(recordings: Sequence[Recording]) -> Recording:
    """Several seeds' traces as one."""
    return Recording(np.concatenate([recording.traces for recording in recordings]), len(recordings))


def trace_file(folder: Path, cell: CellId, key: str) -> Path:
    """Where a cell's traces are saved: an .npz with `traces` (N, T + 1, k) and `signals` (k,), their names.

    For films, `extremes` (2,) says which starts were the best and the worst, and `states` (2, decisions + 1, n) what
    states these went through.
    """
    return folder / f"{cell.name.replace('/', '_')}_{key[:12]}.npz"


def save(path: Path, assessment: Assessment, signals: tuple[str, ...]) -> None:
    """Write what the referee recorded of a policy."""
    robustness = assessment.scores[MAIN].robustness
    extremes = np.array([np.argmax(robustness), np.argmin(robustness)])
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(
        path, traces=assessment.traces, signals=np.array(signals), extremes=extremes, states=assessment.states[extremes]
    )
