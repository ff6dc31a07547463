"""The table of functions: every row complete and consistent, over floats, arrays and intervals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stlbench.stl import Call, Signal, StlSyntaxError, parse
from stlbench.stl.arithmetic.functions import FUNCTIONS
from stlbench.stl.predicates import compile_sample

VALUES = st.one_of(
    st.integers(-8, 8).map(lambda i: i / 4), st.floats(-50, 50), st.sampled_from([math.inf, -math.inf, 1e200, -1e-310])
)
#: each function at 0.5, or at 0.5 and -2, by hand
KNOWN = {
    "abs": 0.5, "sqrt": math.sqrt(2) / 2, "exp": math.sqrt(math.e), "log": -math.log(2), "sin": 0.479425538604203,
    "cos": 0.8775825618903728, "tan": 0.5463024898437905, "tanh": 0.46211715726000973,
    "atan2": math.pi - math.atan(0.25), "min": -2, "max": 0.5, "norm": math.sqrt(4.25), "norminf": 2,
}  # fmt: skip


@pytest.mark.parametrize("name", FUNCTIONS)
def test_values_by_hand(name: str) -> None:
    row = FUNCTIONS[name]
    args = (0.5,) if row.arity == 1 else (0.5, -2.0)
    assert row.floats(*args) == pytest.approx(KNOWN[name], abs=1e-15)
    assert row.arrays(*map(np.array, args)) == pytest.approx(KNOWN[name], abs=1e-15)
    low, high = row.interval([(np.array([arg]), np.array([arg])) for arg in args])
    assert low <= KNOWN[name] + 1e-15
    assert high >= KNOWN[name] - 1e-15
    assert high - low < 1e-14


@pytest.mark.parametrize("name", FUNCTIONS)
@given(st.lists(VALUES, min_size=1, max_size=6))
def test_floats_arrays_domains_and_source_agree(name: str, args: list[float]) -> None:
    row = FUNCTIONS[name]
    args = args[: row.arity] if row.arity else args
    if not row.takes(len(args)):
        args = args * 2
    with np.errstate(all="ignore"):
        array = float(row.arrays(*map(np.float64, args)))
    try:
        number = row.floats(*args)
    except OverflowError:
        number = math.inf
    except (ArithmeticError, ValueError):
        number = math.nan
    assert number == pytest.approx(array, rel=1e-15, abs=0, nan_ok=True)
    if row.domain and math.isfinite(args[0]) and math.isnan(array):
        assert row.domain.may_leave(args[0], args[0])
    if math.isfinite(array):
        names = tuple(f"s{i}" for i in range(len(args)))
        written = compile_sample(parse(f"{name}({', '.join(names)}) >= 0"), names)(args)
        assert (0.0 if abs(written) <= 2.0**-1022 else written) == (0.0 if abs(number) <= 2.0**-1022 else number)


@given(st.floats(-20, 20), st.floats(0, 4))
def test_a_range_without_a_pole_is_where_tan_rises(low: float, width: float) -> None:
    leaves = FUNCTIONS["tan"].domain.may_leave(low, low + width)  # type: ignore[union-attr]
    poles = [math.pi / 2 + math.pi * n for n in range(-8, 10)]
    assert leaves or not any(low <= pole <= low + width for pole in poles)
    assert not leaves or any(low - 1e-6 <= pole <= low + width + 1e-6 for pole in poles)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("tan(x, y) >= 0", "one argument of tan but found 2"),
        ("atan2(x) >= 0", "two arguments of atan2 but found 1"),
        ("atan2(x, y, x) >= 0", "two arguments of atan2 but found 3"),
        ("asin(x) >= 0", r"a function \(abs, sqrt, exp, log"),
        ("log >= 0", r"'\(' after the function log"),
    ],
)
def test_the_parser_reads_the_table(text: str, message: str) -> None:
    with pytest.raises(StlSyntaxError, match=message):
        parse(text)
    with pytest.raises(ValueError, match="atan2 takes two arguments, got 1"):
        Call("atan2", (Signal("x"),))
