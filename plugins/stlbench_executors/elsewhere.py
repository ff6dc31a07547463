"""The life of items that run elsewhere: they wait, are sent, and end; or they are lost, and sent once more."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Generator

from stlbench.contract import Outcome
from stlbench_executors.supervisor import Ended
from stlbench_executors.worker import WorkItems, outcome_of

OFFERS = 2  # so often an item is begun if the worker or the job before was lost


def lost(place: str) -> Ended:
    """The end of an item that is not begun again; the place is "worker" or "job"."""
    return Ended("killed", reason=f"the {place} that ran it was lost, {OFFERS} times")


class RunElsewhere(ABC):
    """Items that wait, items that are left, and outcomes that nobody has taken yet."""

    def __init__(self, items: WorkItems) -> None:
        self._items = items
        self._waiting, self._left = deque(range(len(items))), set(range(len(items)))
        self._offers = [0] * len(items)  # how often each was sent
        self._over = deque[Outcome]()

    def outcomes(self) -> Generator[Outcome]:
        while self._left:
            self._turn()
            while self._over:
                yield self._over.popleft()
            if self._left:
                self._wait()

    @abstractmethod
    def _turn(self) -> None:
        """Send items that wait, and note which have ended."""

    @abstractmethod
    def _wait(self) -> None:
        """Wait for a moment, or until something has ended."""

    def _end(self, index: int, ended: Ended) -> None:
        if index in self._left:  # else of a worker or a job that was thought lost
            self._left.remove(index)
            self._over.append(outcome_of(index, ended))

    def _lose(self, index: int, place: str, most: int = OFFERS) -> None:
        """Have an item sent again, unless it was sent `most` times."""
        if self._offers[index] < most:
            self._waiting.appendleft(index)
        else:
            self._end(index, lost(place))
