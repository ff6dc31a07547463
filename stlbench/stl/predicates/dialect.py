"""Python source of predicates: how one operation is written for a sample of floats and for arrays of samples.

**Signed margins.** One number has both the robustness and the verdict of a formula. Robustness and verdict can
disagree at robustness 0 alone: `x >= 0` holds at x = 0, `x > 0` does not. A signed margin is never 0: the smallest
normal float stands for it, with the sign of the verdict. Minimum, maximum and negation keep signs. So a formula holds
iff its signed value is > 0, and the bounds of a monitor and its verdict come from one pass. The robustness is the
signed value, or 0 within `SIDE` of 0, which is exact but for margins that no normal float can tell from 0. (The
smallest denormal would do too, but training switches denormals off.)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from stlbench.arithmetic import SMALLEST
from stlbench.arithmetic.functions import FUNCTIONS, OPERATIONS
from stlbench.stl.language.syntax import Predicate

#: how far signed margins are from 0, at least
SIDE = SMALLEST


def zero_side(predicate: Predicate) -> float:
    """The signed margin for a margin of 0: above 0 where that holds (<=, >=), below where it does not (<, >)."""
    return SIDE if predicate.op in ("<=", ">=") else -SIDE


@dataclass(frozen=True)
class Dialect:
    """How operations are written, and what the names in the source mean."""

    signal: str  # a column of the argument `sample`
    templates: Mapping[str, str]
    zero: str  # a statement that gives a margin of 0 the sign of the verdict
    zero_or_infinite: str  # the same of a margin that may overflow
    namespace: Mapping[str, Any]
    twice: frozenset[str] = frozenset()  # operations that write an operand twice: it must be a name or a constant
    first: str = ""  # a statement that goes before all others


def _zero_or_nan(h: float, side: float) -> float:
    """The signed margin for one that is neither above nor below 0, or is infinite."""
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
    zero_or_infinite="if not (0.0 < {0} < inf or -inf < {0} < 0.0): {0} = zero_or_nan({0}, {1})",
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
    zero_or_infinite="{0} = where({0} == 0.0, {1}, {0})",
    namespace={name: row.arrays for name, row in FUNCTIONS.items()}
    | {"nan": math.nan, "inf": math.inf, "minimum": np.minimum, "maximum": np.maximum, "logical_not": np.logical_not}
    | {"where": np.where, "isnan": np.isnan, "square": np.square, "quotient": OPERATIONS["/"].arrays}
    | {"type": type, "ndarray": np.ndarray},
    first="if type(sample) is not ndarray or sample.dtype.kind != 'f': sample = as_floats(sample)",
)


def functions(source: Sequence[str], namespace: Mapping[str, Any]) -> dict[str, Callable[..., Any]]:
    """The functions that the lines define, by name. They know the names of `namespace` and no others."""
    scope: dict[str, Any] = {**namespace, "__builtins__": {}}
    # Safe: every character of the source is ours. Signals are column numbers, constants reprs of floats and numbers of
    # steps, operators and functions texts of our tables; `test_compiler` and `test_monitor_source` hold it to that.
    starts = [i for i, line in enumerate(source) if line.startswith("def ")]
    for start, end in pairwise([*starts, len(source)]):  # one at a time, which takes less memory
        exec(compile("\n".join(source[start:end]), "<stlbench.stl>", "exec"), scope)  # noqa: S102
    return {name: value for name, value in scope.items() if name not in namespace and callable(value)}


def indented(lines: Iterable[str]) -> list[str]:
    return [f" {line}" for line in lines]


def block(head: str, lines: Sequence[str]) -> list[str]:
    """`head:` and the lines under it; nothing if there are none."""
    return [f"{head}:", *indented(lines)] if lines else []
