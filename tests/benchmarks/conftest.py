"""How everything here is measured: CPU time, one thread, peers and ours in turns in the same run."""

from __future__ import annotations

import importlib.util
import os
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

Work = Callable[[], Any]

#: of JAX, which reads them when it first computes; with its pool of threads it needs up to twice the CPU time
JAX = {"JAX_PLATFORMS": "cpu", "NPROC": "1", "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false"}


class Race:
    """Times our work and that of peers in turns, A B C A B C, and notes the ratio of each turn.

    A number under a key of `extra_info` is a figure, a list its samples, a text the reason why there is none;
    `collect.py` makes a table of them.
    """

    def __init__(self, benchmark: BenchmarkFixture) -> None:
        self.benchmark = benchmark

    def run(
        self,
        ours: Work,
        peers: Mapping[str, Work],
        turns: int = 7,
        clock: Callable[[], float] = time.process_time,
        warm_up: bool = True,
    ) -> dict[str, list[float]]:
        """Seconds of a call in each turn: key -> times, ours under "ours".

        Args:
            ours: what pytest-benchmark's own table shows.
            peers: key -> the same work by a peer.
            turns: how often each has its turn.
            clock: of the peers; ours has the timer of the benchmark's marker, which should be the same.
            warm_up: call everything once before.
        """
        times: dict[str, list[float]] = {key: [] for key in peers}
        for work in (ours, *peers.values()) if warm_up else ():
            work()

        def others() -> None:
            for key, work in peers.items():
                times[key].append(seconds(work, clock))

        self.benchmark.pedantic(ours, setup=others, rounds=turns, iterations=1)  # type: ignore[no-untyped-call]
        assert self.benchmark.stats is not None
        return times | {"ours": list(self.benchmark.stats.stats.data)}

    def note(self, **figures: float | Sequence[float] | str) -> None:
        """Put figures into the benchmark's record."""
        self.benchmark.extra_info.update(
            {key: list(value) if isinstance(value, list | tuple) else value for key, value in figures.items()}
        )


def seconds(work: Work, clock: Callable[[], float] = time.process_time) -> float:
    """Seconds of one call; CPU seconds of all threads of this process, if no other clock is given."""
    begin = clock()
    work()
    return clock() - begin


def ratios(theirs: Sequence[float], ours: Sequence[float]) -> list[float]:
    """How many times faster ours was, turn by turn."""
    return [their / our for their, our in zip(theirs, ours, strict=True)]


def without(names: Sequence[str]) -> dict[str, str]:
    """Those of the modules that are not installed -> the text to note in place of a number."""
    return {name: f"{name} is not installed" for name in names if importlib.util.find_spec(name) is None}


@pytest.fixture
def race(benchmark: BenchmarkFixture) -> Race:
    """A race, on one thread."""
    if os.environ.get("OMP_NUM_THREADS") != "1":
        pytest.fail("benchmarks are of one thread: set OMP_NUM_THREADS=1 before Python starts, as `make bench` does")
    os.environ |= JAX
    return Race(benchmark)
