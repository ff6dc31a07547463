"""Regions: sets of initial states."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator, PlainSerializer

from stlbench import stl
from stlbench.contract import Array, Truth
from stlbench.task.entry import Entry, Finite, PointFormula


def _both(value: Any) -> Any:
    """A number, where a state is fixed, as an interval."""
    if isinstance(value, int | float):
        return value, value
    if not isinstance(value, list | tuple):
        raise ValueError(f"expected a number or [low, high], got {value!r}")
    return value


def _ordered(ends: tuple[float, float]) -> tuple[float, float]:
    if ends[0] > ends[1]:
        raise ValueError(f"low must not exceed high, got {list(ends)}")
    return ends


def _written(ends: tuple[float, float]) -> tuple[float, float] | float:
    return ends if ends[0] < ends[1] else ends[0]


Ends = Annotated[
    tuple[Finite, Finite], BeforeValidator(_both), AfterValidator(_ordered), PlainSerializer(_written, return_type=Any)
]


class Region(Entry):
    """A set of initial states: a box over the state's names, numbers where a state is fixed, a condition."""

    box: dict[str, Ends]
    where: PointFormula | None = None
    """Over the state's names; initial states fulfil it."""

    @property
    def low(self) -> Array:
        """Lower corner, (n,)."""
        return np.array([low for low, _ in self.box.values()])

    @property
    def high(self) -> Array:
        """Upper corner, (n,)."""
        return np.array([high for _, high in self.box.values()])

    def keep(self, states: Array) -> Array:
        """Those of the states (N, n) that fulfil `where`."""
        return states if self.where is None else states[_predicate(self.where, tuple(self.box))(states)]


@cache
def _predicate(formula: stl.Formula, names: tuple[str, ...]) -> Callable[[Array], Truth]:
    return stl.holds(formula, names)
