"""What it costs to give an item a process of its own: from one answer to the next, of items that do nothing.

    python tests/long/start.py --items 200
    python tests/long/start.py --items 200 --torch

Prints wall milliseconds of the fastest item, of half of them, and of 90 %. With `--torch` the processes are forked from
one that has imported PyTorch, as where an agent needs it.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from itertools import pairwise

from stlbench.contract import Work
from stlbench.study.run import build_executor

__all__ = ["imported", "main", "nothing", "torch_too"]


def nothing(item: int) -> int:
    """The item."""
    return item


def imported() -> None:
    """What every cell needs."""
    import stlbench.study.trial  # noqa: F401


def torch_too() -> None:
    """And PyTorch."""
    imported()
    import torch  # noqa: F401


def measured(count: int, prepare: Callable[[], None]) -> list[float]:
    """Milliseconds between answers, in order; the first, which waits for imports, is left out."""
    outcomes = build_executor("local", 1).run(Work(nothing, prepare), range(count + 1), [60.0] * (count + 1))
    ends = [time.perf_counter() for outcome in outcomes if outcome.status == "done"]
    assert len(ends) == count + 1
    return sorted(1000 * (later - end) for end, later in pairwise(ends))


def main() -> None:
    """See the top of this file."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--items", type=int, default=200)
    options.add_argument("--torch", action="store_true")
    said = options.parse_args()
    took = measured(said.items, torch_too if said.torch else imported)
    half, most = took[len(took) // 2], took[9 * len(took) // 10]
    print(f"{took[0]:.1f} ms, half {half:.1f}, 90 % {most:.1f}; load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    import start  # its functions have a module's name, by which another process finds them

    start.main()
