"""What runs cells: the contract of executors, which import it from `stlbench.contract`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal


def _nothing() -> None:
    """Nothing is to be prepared."""


@dataclass(frozen=True)
class Work:
    """A function for an executor, and what an executor may do for it. It is called as the function itself is."""

    function: Callable[[Any], Any]
    """Importable, of one item."""
    prepare: Callable[[], None] = _nothing
    """Importable. It imports and loads what the function needs for many items, and changes nothing else: an executor
    may call it once in a process from which those of items are forked. What it raises, the function raises again."""
    log: Callable[[Any], Path] | None = None
    """Where what an item writes to standard output and error may be kept; the folder need not be there."""

    facts: Callable[[], Mapping[str, str]] | None = None
    """Importable. It says where it is called: an executor that runs items on other machines calls it there, and gives
    what it says in `Outcome.facts`."""

    def __call__(self, item: Any) -> Any:
        """What the function returns."""
        return self.function(item)


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
    facts: Mapping[str, str] | None = field(default=None, repr=False)
    """What `Work.facts` says where the item ran; empty where that is not known. None means that it ran on the machine
    of the caller."""


class Executor(ABC):
    """Runs a function on many items, each isolated: one that raises, hangs or dies leaves the others alone.

    The constructor, and `run`, raise `stlbench.contract.Unsuitable` where nothing can be run, as without a library or
    without a cluster that answers; its text is what the user is told.

    Args:
        jobs: items at a time. The harness leaves it out where the user does not say, so that the default counts.

    Attributes:
        jobs: the same; 0 where it is only known while items run.
    """

    def __init__(self, *, jobs: int = 1) -> None:
        self.jobs = jobs

    @abstractmethod
    def run(
        self, function: Callable[[Any], Any], items: Sequence[Any], deadlines: Sequence[float]
    ) -> Generator[Outcome]:
        """Yield one outcome per item, as they end, `jobs` at a time.

        Args:
            function: an importable function of one item; stlbench gives a `Work`.
            items: what it is called with, picklable.
            deadlines: seconds of wall time after which each item is stopped with status `timeout`.

        Closing the iterator, or ctrl-C, stops what runs.
        """
