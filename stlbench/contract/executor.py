"""Executors: they run cells. Import them from `stlbench.contract`."""

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
    """A function of one item, with additions that an executor may use. Call it like the function itself."""

    function: Callable[[Any], Any]
    """Importable."""
    prepare: Callable[[], None] = _nothing
    """Importable. It loads what the function needs, and changes nothing else. An executor that forks may call it once
    before. The function raises again what it raises."""
    log: Callable[[Any], Path] | None = None
    """The folder where the standard output and error of an item may be stored; the folder need not exist."""
    facts: Callable[[], Mapping[str, str]] | None = None
    """Importable. An executor that uses other machines calls it there, and puts its result in `Outcome.facts`."""

    def __call__(self, item: Any) -> Any:
        """Call the function."""
        return self.function(item)


@dataclass(frozen=True)
class Outcome:
    """How one call of an executor ended."""

    index: int
    """Which of the items."""
    status: Literal["done", "raised", "timeout", "killed"]
    value: Any = None
    """The function's result, where status is `done`."""
    reason: str = ""
    """One line for a person: "ValueError: ..." or "no result after 60 s" or "killed by signal 9"."""
    details: str = field(default="", repr=False)
    """The traceback, where there is one."""
    facts: Mapping[str, str] | None = field(default=None, repr=False)
    """The result of `Work.facts` where the item ran, or empty. None means: on the machine of the caller."""


class Executor(ABC):
    """Runs a function on many items, each isolated: one that raises, hangs or dies leaves the others alone.

    The constructor and `run` raise `Unsuitable` where nothing can be run, as without a library or a cluster.

    Args:
        jobs: items at a time. The harness leaves it out where the user does not set it.

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
