"""Searches side by side: each gets its own answers, and all end whatever happens."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stlbench.search.optimisers import _parts, side_by_side


def asking(own: int, times: int, heard: dict[int, list[float]]) -> Callable[[Any], None]:
    def search(value: Any) -> None:
        heard[own] = [value(np.array([own, time])) for time in range(times)]

    return search


def test_each_gets_its_own_answers_in_batches_of_those_that_still_ask() -> None:
    heard, sizes = dict[int, list[float]](), list[int]()

    def values(points: Any) -> Any:
        sizes.append(len(points))
        return 10 * points[:, 0] + points[:, 1]

    side_by_side([asking(own, times, heard) for own, times in enumerate([3, 1, 2])], values)
    assert heard == {0: [0, 1, 2], 1: [10], 2: [20, 21]}
    assert sizes == [3, 2, 1]


def test_what_the_values_raise_ends_all() -> None:
    before = threading.active_count()

    def values(points: Any) -> Any:
        raise KeyError("enough")

    with pytest.raises(KeyError, match="enough"):
        side_by_side([asking(own, 5, {}) for own in range(4)], values)
    assert threading.active_count() == before


def test_what_a_search_raises_is_raised_here_and_ends_the_others() -> None:
    before = threading.active_count()

    def broken(value: Any) -> None:
        value(np.zeros(2))
        raise RuntimeError("a bug")

    with pytest.raises(RuntimeError, match="a bug"):
        side_by_side([asking(0, 1000, {}), broken], lambda points: points[:, 0])
    assert threading.active_count() == before


@pytest.mark.parametrize(("size", "count"), [(1, 32), (2, 6**2), (3, 3**3), (5, 2**5), (12, 1)])
def test_parts_tile_the_cube_and_are_about_32(size: int, count: int) -> None:
    objective: Any = SimpleNamespace(box=SimpleNamespace(size=size))
    parts = _parts(objective)
    assert len(parts) == count
    assert sum(math.prod(high - low for low, high in part) for part in parts) == pytest.approx(1)
    assert len({tuple(low for low, _ in part) for part in parts}) == count
