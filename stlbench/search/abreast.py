"""Searches that ask for one value at a time, many of them side by side, so that all are answered in one batch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from queue import SimpleQueue
from threading import Thread
from typing import Any

import numpy as np

from stlbench.contract import Array

Scalar = Callable[[Array], float]
"""From a point (d,) to its value."""


class _Stopped(Exception):
    """Unwinds a search that gets no further answer."""


class _Line:
    """One search in a thread of its own: its questions go to all, its answers come to it alone."""

    def __init__(self, number: int, search: Callable[[Scalar], object], questions: SimpleQueue[Any]) -> None:
        self.number, self._search, self._questions = number, search, questions
        self._answers = SimpleQueue[float | None]()
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self._search(self._ask)
            self._questions.put((self.number, None))
        except _Stopped:
            pass
        except BaseException as error:
            self._questions.put((self.number, error))

    def _ask(self, point: Array) -> float:
        self._questions.put((self.number, np.array(point, dtype=np.float64)))
        answer = self._answers.get()
        if answer is None:
            raise _Stopped
        return answer

    def answer(self, value: float | None) -> None:
        """The value that it waits for; None ends it."""
        self._answers.put(value)

    def join(self) -> None:
        """Wait for its end."""
        self._thread.join()


def abreast(searches: Sequence[Callable[[Scalar], object]], values: Callable[[Array], Array]) -> None:
    """Run searches side by side until all have ended; what each of them asks depends on its own answers alone.

    Args:
        searches: each is called with a function from a point (d,) to its value.
        values: from the points (m, d) that m searches ask for, in their order, to values (m,). What it raises ends all
            searches, and is raised here; so is what a search raises.
    """
    questions = SimpleQueue[Any]()
    going = {number: _Line(number, search, questions) for number, search in enumerate(searches)}
    lines = list(going.values())
    try:
        while going:
            asked = dict(questions.get() for _ in range(len(going)))
            for number in [number for number, point in asked.items() if not isinstance(point, np.ndarray)]:
                del going[number]
                if isinstance(error := asked.pop(number), BaseException):
                    raise error
            if asked:
                order = sorted(asked)
                for number, value in zip(order, values(np.stack([asked[i] for i in order])).tolist(), strict=True):
                    going[number].answer(value)
    finally:
        for line in going.values():
            line.answer(None)
        for line in lines:
            line.join()
