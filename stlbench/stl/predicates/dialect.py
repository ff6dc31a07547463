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

    The templates of the operations `twice` write an operand more than once; theirs are therefore names or constants.
    """

    signal: str
    """A column of the argument `sample`."""
    templates: Mapping[str, str]
    zero: str
    """A statement that gives a margin of 0 the sign of the verdict."""
    namespace: Mapping[str, Any]
    twice: frozenset[str] = frozenset()
    first: str = ""
    """A statement that goes before all others."""


def _quotient(left: Any, right: Any) -> Any:
    """left / right, NaN where right is 0, as everywhere that a function has no value."""
    return left / np.where(right == 0.0, math.nan, right)


def _zero_or_nan(h: float, side: float) -> float:
    """What stands for a margin that is neither above nor below 0."""
    if h == 0.0:
        return side
    raise ArithmeticError


_BOTH = {"-u": "(-{0})", "+": "({0} + {1})", "-": "({0} - {1})", "*": "({0} * {1})", "**": "({0} ** {1})"}
_BOTH |= {"/constant": "({0} / {1})"}
#: `lower` and `higher` are NaN if an operand is; a - b would be NaN too where both are the same infinity, so it is not
#: asked. `least` and `greatest` join predicates, which are never NaN.
FLOATS = Dialect(
    signal="sample[{0}]",
    templates=_BOTH
    | {
        "square": "({0} * {0})",
        "one": "(1.0 if {0} == {0} else nan)",
        "/": "({0} / {1})",
        "lower": "({0} if {0} <= {1} else {1} if {1} < {0} else nan)",
        "higher": "({0} if {0} >= {1} else {1} if {1} > {0} else nan)",
        "least": "({0} if {0} < {1} else {1})",
        "greatest": "({0} if {0} > {1} else {1})",
    },
    zero="if not ({0} > 0.0 or {0} < 0.0): {0} = zero_or_nan({0}, {1})",
    namespace={name: row.floats for name, row in FUNCTIONS.items()}
    | {"nan": math.nan, "inf": math.inf, "zero_or_nan": _zero_or_nan}
    | {"ArithmeticError": ArithmeticError, "ValueError": ValueError},
    twice=frozenset({"square", "one", "lower", "higher", "least", "greatest"}),
)
ARRAYS = Dialect(
    signal="sample[..., {0}]",
    templates=_BOTH
    | {
        "square": "square({0})",
        "one": "where(isnan({0}), nan, 1.0)",
        "/": "quotient({0}, {1})",
        "lower": "minimum({0}, {1})",
        "higher": "maximum({0}, {1})",
        "least": "minimum({0}, {1})",
        "greatest": "maximum({0}, {1})",
        "not": "logical_not({0})",
    },
    zero="{0} = where({0} == 0.0, {1}, {0})",
    namespace={name: row.arrays for name, row in FUNCTIONS.items()}
    | {"nan": math.nan, "inf": math.inf, "minimum": np.minimum, "maximum": np.maximum, "logical_not": np.logical_not}
    | {
        "where": np.where,
        "isnan": np.isnan,
        "square": np.square,
        "quotient": _quotient,
        "type": type,
        "ndarray": np.ndarray,
        "as_array": as_array,
    },
    first="if type(sample) is not ndarray: sample = as_array(sample)",
)
