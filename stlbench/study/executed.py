"""The outcomes of an executor, checked: one that fails or breaks its contract is told with its name, in a line."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from stlbench.contract import Executor, Outcome, Unsuitable, cause
from stlbench.contract_parts.texts import one_line
from stlbench.errors import UsageError
from stlbench.registry import plugins

__all__ = ["failing", "outcomes"]


def outcomes(
    executor: Executor, function: Callable[[Any], Any], items: Sequence[Any], deadlines: Sequence[float]
) -> Generator[Outcome]:
    """Yield what `executor.run` yields: one outcome per item, as they end.

    Raises:
        UsageError: it raises anything but `Unsuitable`, gives no generator of outcomes, or not one for each item.
    """
    name, left = _name(executor), set(range(len(items)))
    with failing(name):
        found = executor.run(function, items, deadlines)
    if not isinstance(found, Generator):
        raise UsageError(f"{name}: its run should be a generator of outcomes, it gives {type(found).__name__}")
    try:
        for outcome in _each(name, found):
            if not (isinstance(outcome, Outcome) and outcome.index in left):
                rule = f"its run should give one outcome for each of {len(items)} items"
                raise UsageError(f"{name}: {rule}, it gives {one_line(repr(outcome))}")
            left.remove(outcome.index)
            yield outcome
        if left:
            raise UsageError(f"{name}: its run ended without the outcomes of {len(left)} of {len(items)} items")
    finally:
        with failing(name):
            found.close()


@contextmanager
def failing(name: str) -> Iterator[None]:
    """What an executor of that name raises is a `UsageError`; that it cannot run here, `Unsuitable`, stays so."""
    try:
        yield
    except (Unsuitable, UsageError):
        raise
    except (Exception, SystemExit) as error:
        raise UsageError(f"{name} failed: {cause(error)}") from error


def _each(name: str, found: Generator[Any]) -> Iterator[Any]:
    """All that it yields; what is raised by who takes it is none of its errors."""
    while True:
        with failing(name):
            try:
                outcome = next(found)
            except StopIteration:
                return
        yield outcome


def _name(executor: Executor) -> str:
    name = plugins.name_of("executors", type(executor))
    return f"executor {type(executor).__name__}" if name is None else str(plugins.find("executors", name))
