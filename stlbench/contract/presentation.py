"""What a plugin may show beside its work, in tables, figures and films. All of it is optional.

A reward method or a system that has one of these methods is shown by it; no base class is needed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import Array
from stlbench.stl import Term

__all__ = ["Band", "Banded", "Described", "Drawn", "Pixels"]

Pixels = NDArray[np.uint8]


@runtime_checkable
class Described(Protocol):
    """A reward method that says what it makes of a task."""

    def describe(self) -> Mapping[str, Any]:
        """For `stlbench show task`: short names to numbers, texts or lists."""


@dataclass(frozen=True)
class Band:
    """Between which bounds a method wants the margin of a term in the course of time."""

    term: Term
    """One of `Specification.terms`."""
    start: int
    """The step of the first number of both bounds."""
    lower: Array
    """(n,): at steps start, start + 1, ..., in the unit of the term's predicates."""
    upper: Array
    """(n,)."""


@runtime_checkable
class Banded(Protocol):
    """A reward method that bounds the robustness of terms, which figures draw."""

    def band(self) -> Sequence[Band]:
        """At most one band per term."""


@runtime_checkable
class Drawn(Protocol):
    """A system that can draw itself, for films and for Gymnasium's `render`."""

    def frame(self, state: Array) -> Pixels:
        """A picture of one state (n,): (height, width, 3), always of one size.

        Raises `RuntimeError`, in one line, where this machine lacks what it takes to draw.
        """
