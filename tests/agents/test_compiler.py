"""Numba's decorators, and calls that do not look at types."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from stlbench_agents.compiler import OneKind


@njit
def _counted(into: Any, pair: tuple[Any, float], times: int) -> None:
    into[times] += pair[0][times] * pair[1]


def test_a_call_of_one_kind_does_what_the_function_does() -> None:
    into, call = np.zeros(3), OneKind(_counted)
    for times in range(3):
        call(into, (np.arange(3.0), 0.5), times)
    assert into.tolist() == [0.0, 0.5, 1.0]
    assert len(_counted.signatures) == 1
