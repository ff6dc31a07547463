"""Messages say what, where and what would be right."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from stlbench import stl
from stlbench.stl import FragmentError, Position, ShortTraceError, StlSyntaxError, UndefinedError, UnknownSignalError


def test_all_are_value_errors() -> None:
    for kind in (FragmentError, ShortTraceError, StlSyntaxError, UndefinedError, UnknownSignalError):
        assert issubclass(kind, ValueError)


def test_caret_stays_under_its_column_in_long_lines() -> None:
    text = "x" * 300 + "@" + "x" * 300
    first, source, caret = str(StlSyntaxError(text, Position(1, 301), "a name", "'@'")).split("\n")
    assert first == "line 1, column 301: expected a name but found '@'"
    assert len(source) < 110
    assert source[caret.index("^")] == "@"


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["x", "theta"], "formula uses signal 'thta'; the trace has x, theta (did you mean 'theta'?)"),
        (["x"], "formula uses signal 'thta'; the trace has x"),
        ([], "formula uses signal 'thta'; the trace has none"),
    ],
)
def test_unknown_signal(names: list[str], message: str) -> None:
    assert str(UnknownSignalError("thta", names)) == message


def test_positions_name_the_line_only_where_there_are_several() -> None:
    assert str(Position(1, 12)) == "column 12"
    assert str(Position(3, 1)) == "line 3, column 1"


@pytest.mark.parametrize("text", ["x >= \ud800", "\udc80", "x >= 1 & y \ud800 1"])
def test_a_message_about_a_lone_surrogate_can_be_written(text: str) -> None:
    with pytest.raises(StlSyntaxError) as error:
        stl.parse(text)
    assert "?" in str(error.value).encode().decode()


@pytest.mark.parametrize("text", ["\n" * 200_001, "x" * 199_999 + "\n\n", "a" * 200_001])
def test_columns_count_from_1_in_texts_that_are_too_long(text: str) -> None:
    with pytest.raises(StlSyntaxError) as error:
        stl.parse(text)
    assert min(error.value.line, error.value.column) >= 1


@pytest.mark.parametrize("psi", ["x ** 0 >= 0", "(x - x) ** 0 * 0 >= 0", "y >= 0 & (2 * x) ^ 0 <= 2"])
def test_a_power_of_nan_is_nan_whatever_the_exponent(psi: str) -> None:
    formula, names, bad = stl.parse(psi), ["x", "y"], [np.nan, 0.0]
    assert np.isnan(stl.margin(formula, names)(np.array(bad)))
    for evaluate in (lambda: stl.robustness(formula, [bad], names), lambda: stl.Monitor(formula, names).update(bad)):
        with pytest.raises(UndefinedError, match="'x' is NaN at sample 0"):
            evaluate()
    assert stl.margin(stl.parse("x ** 0 >= 0"), ["x"])(np.array([[0.0], [np.inf], [-3.0]])).tolist() == [1, 1, 1]


@pytest.mark.filterwarnings("error")
def test_what_has_no_value_or_overflows_gives_no_warning() -> None:
    for psi, sample in [("sqrt(x) >= 0", -1.0), ("exp(x) >= 0", 1e3), ("1 / x >= 0", 0.0), ("x >= x", np.inf)]:
        stl.margin(stl.parse(psi), ["x"])(np.array([sample]))
        stl.holds(stl.parse(psi), ["x"])(np.array([[sample]]))


RAISING: dict[str, Callable[[], Any]] = {
    "StlSyntaxError": lambda: stl.parse("x >"),
    "FormulaLimitError": lambda: stl.And((stl.parse("x > 0"),) * 100_001),
    "UnknownSignalError": lambda: stl.robustness(stl.parse("x > 0"), [[1.0]], ["y"]),
    "AmbiguousError": lambda: stl.robustness(stl.parse("x > pi"), [[1.0, 2.0]], ["x", "pi"]),
    "ShortTraceError": lambda: stl.robustness(stl.parse("G[0,5] x > 0"), [[1.0]], ["x"]),
    "UnboundedError": lambda: stl.horizon(stl.parse("G x > 0")),
    "UndefinedError": lambda: stl.robustness(stl.parse("x > 0"), [[np.nan]], ["x"]),
    "FragmentError": lambda: stl.fragment(stl.parse("x > 0 U[0,1] x > 1")),
}


@pytest.mark.parametrize("name", RAISING)
def test_each_error_survives_pickling(name: str) -> None:
    with pytest.raises(getattr(stl, name)) as caught:
        RAISING[name]()
    again = pickle.loads(pickle.dumps(caught.value))
    assert type(again) is type(caught.value)
    assert (str(again), again.args, vars(again)) == (str(caught.value), caught.value.args, vars(caught.value))
