"""How one operation is written, for a sample of floats and for arrays of samples: the two namespaces of the source."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from stlbench.stl.functions.table import FUNCTIONS
from stlbench.stl.predicates.inputs import as_array


@dataclass(frozen=True)
class Dialect:
    """Templates of what is written differently, and what the names in the source mean.

    A template may write an operand twice; the operands of `twice` are therefore names or constants.
    """

    signal: str
    templates: Mapping[str, str]
    namespace: Mapping[str, Any]
    first: str = ""
    """A statement that goes before all others."""


def _quotient(left: Any, right: Any) -> Any:
    """left / right, NaN where right is 0, as everywhere that a function has no value."""
    return left / np.where(right == 0.0, math.nan, right)


def _signed(h: Any, side: float) -> Any:
    return np.where(h == 0.0, side, h)


_BOTH = {"-u": "(-{0})", "+": "({0} + {1})", "-": "({0} - {1})", "*": "({0} * {1})", "**": "({0} ** {1})"}
#: operations whose template writes an operand more than once, in some dialect
TWICE = frozenset({"square", "lower", "higher", "least", "greatest"})

#: `lower` and `higher` are NaN if an operand is; a - b would be NaN too where both are the same infinity, so it is not
#: asked. `least` and `greatest` join predicates, which are never NaN.
FLOATS = Dialect(
    signal="sample[{0}]",
    templates=_BOTH
    | {
        "square": "({0} * {0})",
        "/": "({0} / {1})",
        "lower": "({0} if {0} <= {1} else {1} if {1} < {0} else nan)",
        "higher": "({0} if {0} >= {1} else {1} if {1} > {0} else nan)",
        "least": "({0} if {0} < {1} else {1})",
        "greatest": "({0} if {0} > {1} else {1})",
    },
    namespace={name: row.floats for name, row in FUNCTIONS.items()} | {"nan": math.nan, "inf": math.inf},
)
ARRAYS = Dialect(
    signal="sample[..., {0}]",
    templates=_BOTH
    | {
        "square": "({0} * {0})",
        "/": "quotient({0}, {1})",
        "lower": "minimum({0}, {1})",
        "higher": "maximum({0}, {1})",
        "least": "minimum({0}, {1})",
        "greatest": "maximum({0}, {1})",
        "not": "logical_not({0})",
        "signed": "signed({0}, {1})",
    },
    namespace={name: row.arrays for name, row in FUNCTIONS.items()}
    | {"nan": math.nan, "inf": math.inf, "minimum": np.minimum, "maximum": np.maximum, "logical_not": np.logical_not}
    | {"quotient": _quotient, "signed": _signed, "ndarray": np.ndarray, "as_array": as_array},
    first="if type(sample) is not ndarray: sample = as_array(sample)",
)
