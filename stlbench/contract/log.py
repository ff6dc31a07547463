"""Logs: they follow a run. Import them from `stlbench.contract`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class LoggedCheckpoint:
    """A checkpoint of one cell, scored on the starts for selection."""

    cell: str
    """Its name, task/method/agent/seed, and the track unless that is `shared`."""
    steps: int
    """Environment steps of the training so far."""
    satisfaction: float
    """The share of the starts that satisfy, in [0, 1]."""
    robustness: float
    """The mean over the starts, in the unit of the task's predicates."""


@dataclass(frozen=True)
class LoggedCell:
    """How a cell ended."""

    cell: str
    budget: str
    status: str
    """`done`, or `raised`, `timeout`, `killed`, `intractable`, `unsuitable`."""
    reason: str = ""
    """One line, where the status is not `done`."""
    numbers: Mapping[str, float] = field(default_factory=dict)
    """For a cell that is `done`: `satisfaction` and `robustness` of the selected policy on the report starts,
    `final_satisfaction` and `final_robustness` of the last one, `cpu_seconds`, `wall_seconds`, `env_steps`."""
    curve: tuple[LoggedCheckpoint, ...] = ()
    """All checkpoints."""


class RunLog(ABC):
    """Follows a run for a tool that shows it, such as TensorBoard.

    Each run has one instance, in the process of `stlbench run`. Its functions are called one at a time, in a thread of
    its own: `begin` first, `end` last. If one raises or takes too long, the log is turned off, and the run goes on.
    Nothing that it does may change a result. The constructor raises `Unsuitable` where it cannot work, as without a
    library.
    """

    def begin(self, folder: Path, cells: tuple[str, ...]) -> None:  # noqa: B027
        """A run begins.

        Args:
            folder: of results. The log may write to a folder of its own there, which may have files of an earlier run.
            cells: the names of the cells that are going to run.
        """

    @abstractmethod
    def ended(self, cell: LoggedCell) -> None:
        """A cell has ended."""

    def end(self) -> None:  # noqa: B027
        """The run has ended, or was interrupted."""
