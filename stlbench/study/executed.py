"""The outcomes of an executor, checked: one that fails or breaks its contract is told with its name, in a line."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn

from stlbench.contract import Executor, Outcome, Unsuitable, cause
from stlbench.errors import UsageError, one_line
from stlbench.registry import plugins


def outcomes(
    executor: Executor, function: Callable[[Any], Any], items: Sequence[Any], deadlines: Sequence[float]
) -> Generator[Outcome]:
    """Yield what `executor.run` yields: one outcome per item, as they end.

    Raises:
        UsageError: it raises anything but `Unsuitable`, gives no generator of outcomes, or not one for each item.
    """
    left = set(range(len(items)))
    with failing(executor):
        found = executor.run(function, items, deadlines)
    if not isinstance(found, Generator):
        _refuse(executor, f"its run should be a generator of outcomes, it gives {type(found).__name__}")
    try:
        for outcome in _each(executor, found):
            if not (isinstance(outcome, Outcome) and outcome.index in left):
                rule = f"its run should give one outcome for each of {len(items)} items"
                _refuse(executor, f"{rule}, it gives {one_line(repr(outcome))}")
            left.remove(outcome.index)
            yield outcome
        if left:
            _refuse(executor, f"its run ended without the outcomes of {len(left)} of {len(items)} items")
    finally:
        with failing(executor):
            found.close()


@contextmanager
def failing(executor: Executor | str) -> Iterator[None]:
    """What an executor raises, or one of that name, is a `UsageError`; `Unsuitable` stays so: it cannot run here."""
    try:
        yield
    except (Unsuitable, UsageError):
        raise
    except (Exception, SystemExit) as error:
        raise UsageError(f"{_name(executor)} failed: {cause(error)}") from error


def _refuse(executor: Executor, what: str) -> NoReturn:
    raise UsageError(f"{_name(executor)}: {what}")


def _each(executor: Executor, found: Generator[Any]) -> Iterator[Any]:
    """All that it yields; what is raised by who takes it is none of its errors."""
    while True:
        with failing(executor):
            try:
                outcome = next(found)
            except StopIteration:
                return
        yield outcome


def _name(executor: Executor | str) -> str:
    """Looked up after an error alone, as it imports all executors."""
    name = executor if isinstance(executor, str) else plugins.name_of("executors", type(executor))
    return f"executor {type(executor).__name__}" if name is None else str(plugins.find("executors", name))
