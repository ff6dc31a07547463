"""Additions for plugins with something to show in tables, figures and films. They need no base class."""

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
    """A reward method that says how it reads a task."""

    def describe(self) -> Mapping[str, Any]:
        """For `stlbench show task`: short names to numbers, texts or lists."""


@dataclass(frozen=True)
class Band:
    """Bounds of a method on the margin of a term, over time."""

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
    """A reward method with bounds on the robustness of terms. Figures draw them."""

    def band(self) -> Sequence[Band]:
        """At most one band per term."""


@runtime_checkable
class Drawn(Protocol):
    """A system that can draw itself, for films and for Gymnasium's `render`."""

    def frame(self, state: Array) -> Pixels:
        """A picture of one state (n,): (height, width, 3), always of one size.

        Raises `RuntimeError`, in one line, if this machine cannot draw.
        """
