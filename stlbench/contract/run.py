"""Around a run: executors, which run cells, and logs, which follow it. Import them from `stlbench.contract`."""

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
    """The end of one call of an executor."""

    index: int
    """The place of the item in `items`."""
    status: Literal["done", "raised", "timeout", "killed"]
    value: Any = None
    """The function's result, where status is `done`."""
    reason: str = ""
    """One line for a person: "ValueError: ..." or "no result after 60 s" or "killed by signal 9"."""
    details: str = field(default="", repr=False)
    """The traceback, if there is one."""
    facts: Mapping[str, str] | None = field(default=None, repr=False)
    """The result of `Work.facts` where the item ran, or empty. None means: on the machine of the caller."""


class Executor(ABC):
    """Runs a function on many items, each isolated: one that raises, hangs or dies leaves the others alone.

    The constructor and `run` raise `Unsuitable` if nothing can be run, as without a library or a cluster.

    Args:
        jobs: items at a time. The harness leaves it out if the user does not set it.

    Attributes:
        jobs: the same; 0 if it is only known while items run.
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
            items: its arguments, one for each call, picklable.
            deadlines: seconds of wall time after which each item is stopped with status `timeout`.

        Closing the iterator, or ctrl-C, stops what runs.
        """


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
