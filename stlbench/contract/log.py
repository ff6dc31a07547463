"""What is told how a run goes on: the contract of logs, which import it from `stlbench.contract`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class LoggedCheckpoint:
    """A checkpoint of one cell, scored on starts that are kept for selection."""

    cell: str
    """Its name, task/method/agent/seed, and the track where that is not `shared`."""
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
    """Of a cell that is `done`, the referee's: `satisfaction` and `robustness` of the selected policy over the reported
    starts, `final_satisfaction` and `final_robustness` of the last one, `cpu_seconds`, `wall_seconds`, `env_steps`."""
    curve: tuple[LoggedCheckpoint, ...] = ()
    """All checkpoints, scored by the referee on more starts than while the cell ran."""


class RunLog(ABC):
    """Is told how a run goes on, for a tool that shows it, such as TensorBoard.

    One instance is made for each run, in the process of `stlbench run`. Its functions are called one at a time, in a
    thread of its own: `begin` first, `end` last. What it raises, and what takes too long, turns it off, with a line
    that says so; the run goes on. Nothing that it does may change a result.

    The constructor raises `stlbench.contract.Unsuitable` where it cannot work, as without a library; its text is what
    the user is told, before anything runs.
    """

    def begin(self, folder: Path, cells: tuple[str, ...]) -> None:  # noqa: B027
        """A run begins.

        Args:
            folder: of results, where files may be put in a folder of one's own. It may have some of an earlier run,
                which this one continues.
            cells: the names of those that are going to run.
        """

    def checkpoint(self, checkpoint: LoggedCheckpoint) -> None:  # noqa: B027
        """A cell that runs has come to a checkpoint, scored on a few starts. Of quick cells some are left out."""

    @abstractmethod
    def ended(self, cell: LoggedCell) -> None:
        """A cell has ended."""

    def end(self) -> None:  # noqa: B027
        """The run has ended, or was interrupted."""
