"""Numba's decorators, and calls that do not look at types."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba import njit

from stlbench_agents.compiler import OneKind, part


@njit
def _counted(into: Any, pair: tuple[Any, float], times: int) -> None:
    into[times] += pair[0][times] * pair[1]


@part
def _doubled(into: Any) -> None:
    into[0] *= 2


@njit
def _doubled_twice(into: Any) -> None:
    _doubled(into)
    _doubled(into)


def test_a_part_is_called_by_compiled_functions_alone() -> None:
    """It has no code by which Python could call it: that would end the process."""
    into = np.ones(1)
    _doubled_twice(into)
    assert into.tolist() == [4.0]
    with pytest.raises(TypeError, match="_doubled is called by compiled functions alone"):
        _doubled(into)
    assert into.tolist() == [4.0]


def test_a_call_of_one_kind_does_what_the_function_does() -> None:
    into, call = np.zeros(3), OneKind(_counted)
    for times in range(3):
        call(into, (np.arange(3.0), 0.5), times)
    assert into.tolist() == [0.0, 0.5, 1.0]
    assert len(_counted.signatures) == 1
