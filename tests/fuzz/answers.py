"""What any input may lead to: an answer, or a refusal in clear words; never a traceback, never a hang."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from stlbench.errors import printable

__all__ = ["HANG", "answer", "fuzz", "sizes", "soon"]

HANG = 120
"""Seconds after which something small hangs, also on a machine that is busy."""


def sizes(short: int, long: int) -> Any:
    """Run a test on a quarter of `short` examples, every night on all of them, the same ones each time.

    Behind the marker `long` it runs on more, and on new ones: a file takes about ten minutes of processor time.
    """
    tiers = [pytest.param(short, marks=pytest.mark.slow), pytest.param(long, marks=pytest.mark.long)]
    return pytest.mark.parametrize("examples", [max(3, short // 4), *tiers])


def fuzz(examples: int, strategy: st.SearchStrategy[Any], check: Callable[[Any], None]) -> None:
    """Try a check on examples. What fails is shown; where there are many examples, it is made small before."""
    is_long = examples >= 500

    @settings(
        max_examples=examples,
        deadline=None,
        database=None,
        derandomize=not is_long,
        print_blob=is_long,
        phases=list(Phase) if is_long else [Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(strategy)
    def run(example: Any) -> None:
        with soon():
            check(example)

    run()


@contextmanager
def soon() -> Iterator[None]:
    """What takes longer than `HANG` seconds fails."""

    def hangs(*_: object) -> None:
        raise AssertionError(f"no answer after {HANG} s")

    before = signal.signal(signal.SIGALRM, hangs)
    signal.alarm(HANG)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def answer(done: Any) -> bool:
    """Whether a command gave an answer; False where it refused, as it should: in one message, with exit code 2.

    Any exception but `SystemExit` has been raised before.
    """
    shown = done.stdout + done.stderr
    assert "Traceback" not in shown
    assert printable(shown, len(shown)) == shown
    if done.exit_code == 0:
        return True
    assert done.exit_code == 2, done.output
    assert done.stdout == ""
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1, done.stderr
    assert len(errors[0]) > len("error: ")
    return False
