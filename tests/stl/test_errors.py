"""Messages say what, where and what would be right."""

from __future__ import annotations

import pytest

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
