"""The values of the parts of a formula without temporal operators, and how they are combined."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field

from stlbench import stl
from stlbench.contract import Array, Specification, Unsuitable

SemanticsName: TypeAlias = Literal["classic", "lse", "gilpin", "agm", "gmsr"]
Sharpness: TypeAlias = Annotated[float, Field(gt=0, le=100)]


@dataclass(frozen=True)
class Margins:
    """Margins; divided by the largest size over the box of the signals where the semantics is made for [-1, 1].

    Raises:
        Unsuitable: a margin has no bounds, as that of `True`.
    """

    specification: Specification
    semantics: stl.Semantics

    def of(self, leaf: stl.Formula) -> Callable[[Array], Array]:
        margin, unit = self.specification.margin(leaf), self._unit(leaf)
        return margin if unit == 1 else lambda samples: margin(samples) / unit

    def range(self, leaf: stl.Formula) -> tuple[float, float]:
        low, high = self.specification.range(leaf)
        return low / self._unit(leaf), high / self._unit(leaf)

    def _unit(self, leaf: stl.Formula) -> float:
        low, high = self.specification.range(leaf)
        if not (isfinite(low) and isfinite(high)):
            raise Unsuitable(f"the robustness of {leaf} has no bounds")
        return max(abs(low), abs(high)) if self.semantics.divided else 1.0


@dataclass(frozen=True)
class Truths:
    """1 where a leaf holds, else 0."""

    specification: Specification
    semantics: stl.Semantics

    def of(self, leaf: stl.Formula) -> Callable[[Array], Array]:
        holds = self.specification.holds(leaf)
        return lambda samples: holds(samples).astype(np.float64)

    def range(self, leaf: stl.Formula) -> tuple[float, float]:
        return 0.0, 1.0


Values: TypeAlias = Margins | Truths  # of leaves, and what combines them
