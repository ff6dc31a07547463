"""The checks of an executor: the built-in one keeps the rules, and what breaks one is told which."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from typing import Any

import pytest

from stlbench.contract import Executor, Outcome, cause
from stlbench.testing import Rules, check_executor


def test_the_built_in_executor() -> None:
    rules = Rules()
    check_executor("local", rules)
    assert rules.kept[-1] == "closing the iterator stops what runs"


class Inline(Executor):
    """In this process, one after the other."""

    def run(
        self, function: Callable[[Any], Any], items: Sequence[Any], deadlines: Sequence[float]
    ) -> Generator[Outcome]:
        for index, item in enumerate(items):
            try:
                yield self.changed(Outcome(index, "done", function(item)))
            except Exception as error:
                yield self.raised(index, error)

    def changed(self, outcome: Outcome) -> Outcome:
        return outcome

    def raised(self, index: int, error: Exception) -> Outcome:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        return Outcome(index, "raised", reason=reason, details="in _work")


class Reusing(Executor):
    """A process for each job, used again and again."""

    def run(
        self, function: Callable[[Any], Any], items: Sequence[Any], deadlines: Sequence[float]
    ) -> Generator[Outcome]:
        with ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=self.reused) as pool:
            for index, item in enumerate(items):
                try:
                    yield Outcome(index, "done", pool.submit(function, item).result())
                except Exception as error:
                    yield Outcome(index, "raised", reason=cause(error), details="in _work")

    reused: int | None = None


class Misplaced(Reusing):
    """Says of all items that they ran on a machine that there is not."""

    def run(self, *arguments: Any) -> Generator[Outcome]:
        yield from (replace(outcome, facts={"host": "nowhere"}) for outcome in super().run(*arguments))


class Forgetful(Reusing):
    """A new process each time, whose children go on."""

    reused = 1


def broken(**parts: Any) -> type[Executor]:
    return type("Broken", (Inline,), parts)


def raising(reason: Callable[[Exception], str]) -> type[Executor]:
    return broken(raised=lambda self, index, error: Outcome(index, "raised", reason=reason(error)))


@pytest.mark.parametrize(
    ("executor", "rule"),
    [
        (Inline, "items run in another process than the caller's"),
        (Reusing, "what an item changes in its process, the next one does not see"),
        (Misplaced, "`Outcome.facts` are of the machine on which the item ran, None of the caller's"),
        (Forgetful, "a process that an item has started ends with it"),
        (broken(changed=lambda self, o: replace(o, index=3 - o.index)), "with one job, items end in their order"),
        (broken(changed=lambda self, o: replace(o, value=1)), "an outcome has the value of its own item"),
        (broken(changed=lambda self, o: replace(o, status="killed")), "an item that returns is done"),
        (broken(raised=lambda self, index, error: Outcome(index, "killed")), "an item that raises has raised"),
        (raising(lambda error: f"ValueError: {error}"), "the exception is the reason, in one line"),
        (raising(lambda error: "ValueError: item 7"), "the traceback is in the details"),
    ],
)
def test_an_executor_that_breaks_a_rule_is_told_which(executor: type[Executor], rule: str) -> None:
    with pytest.raises(AssertionError, match=f"^rule broken: {rule}"):
        check_executor(executor)
