"""What an executor of ours is asked to do, and what it makes of how an item's process ended."""

from __future__ import annotations

import pickle
import traceback
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from stlbench.contract import Outcome, Work, cause
from stlbench_executors.cell import Answer
from stlbench_executors.keeper import Ended, Task


class Order:
    """The arguments of `Executor.run`, checked.

    Raises:
        ValueError: an item has no deadline.
    """

    def __init__(self, function: Callable[[Any], Any], items: Sequence[Any], deadlines: Sequence[float]) -> None:
        if len(deadlines) != len(items) or any(deadline <= 0 for deadline in deadlines):
            raise ValueError("each item needs a deadline, in seconds and greater than 0")
        self.work = function if isinstance(function, Work) else Work(function)
        self._items, self.deadlines = items, deadlines

    def __len__(self) -> int:
        return len(self._items)

    @property
    def prepare(self) -> bytes:
        """Pickled: what many items need (`Work.prepare`)."""
        return pickle.dumps(self.work.prepare)

    def task(self, index: int) -> Task:
        """What the keeper of an item is given."""
        item = self._items[index]
        log = None if self.work.log is None else Path(self.work.log(item)).absolute()
        facts = b"" if self.work.facts is None else pickle.dumps(self.work.facts)
        return Task(pickle.dumps((self.work.function, item)), self.deadlines[index], log, facts)


def outcome_of(index: int, said: Ended) -> Outcome:
    """How an item ended, for the harness."""
    return replace(_outcome_of(index, said), facts=said.facts or {})


def _outcome_of(index: int, said: Ended) -> Outcome:
    if said.status != "answered":
        return Outcome(index, said.status, reason=said.reason)
    try:
        answer = Answer(*pickle.loads(said.answer))  # noqa: S301 - from our own process
        if answer.reason:
            return Outcome(index, "raised", reason=answer.reason, details=answer.details)
        return Outcome(index, "done", pickle.loads(answer.value))  # noqa: S301 - as above
    except Exception as error:
        return Outcome(index, "raised", reason=cause(error), details=traceback.format_exc())
