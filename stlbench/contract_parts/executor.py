"""What runs cells: the contract of executors, which import it from `stlbench.contract`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

__all__ = ["Executor", "Outcome"]


@dataclass(frozen=True)
class Outcome:
    """How one call of an executor ended."""

    index: int
    """Which of the items."""
    status: Literal["done", "raised", "timeout", "killed"]
    value: Any = None
    """What the function returned, where status is `done`."""
    reason: str = ""
    """One line for a person: "ValueError: ..." or "no result after 60 s" or "killed by signal 9"."""
    details: str = field(default="", repr=False)
    """The traceback, where there is one."""


class Executor(ABC):
    """Runs a function on many items, each isolated: one that raises, hangs or dies leaves the others alone."""

    def __init__(self, *, jobs: int = 1) -> None:
        self.jobs = jobs

    @abstractmethod
    def run(
        self, function: Callable[[Any], Any], items: Sequence[Any], deadlines: Sequence[float]
    ) -> Generator[Outcome]:
        """Yield one outcome per item, as they end, `jobs` at a time.

        Args:
            function: an importable function of one item.
            items: what it is called with, picklable.
            deadlines: seconds of wall time after which each item is stopped with status `timeout`.

        Closing the iterator, or ctrl-C, stops what runs.
        """
