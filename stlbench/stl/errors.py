"""What can go wrong in `stlbench.stl`, each with a message that names the broken rule and what would be right."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from typing import NamedTuple


class Position(NamedTuple):
    """A place in formula text; `line` and `column` count from 1."""

    line: int
    column: int

    def __str__(self) -> str:
        return f"column {self.column}" if self.line == 1 else f"line {self.line}, column {self.column}"


class StlSyntaxError(ValueError):
    """Formula text that does not parse.

    Attributes:
        line, column: where, both from 1.
        expected: what would have been right there, in words.
    """

    def __init__(self, text: str, position: Position, expected: str, found: str) -> None:
        """Build the message: place, rule, source line and a caret under the place."""
        self.line, self.column = position
        self.expected = expected
        lines = text.splitlines()
        source = lines[self.line - 1] if self.line <= len(lines) else ""
        shown, caret = _excerpt(source, self.column)
        super().__init__(
            f"line {self.line}, column {self.column}: expected {expected} but found {found}\n    {shown}\n    {caret}^"
        )


class UnknownSignalError(ValueError):
    """A formula uses a signal that the trace (or the box) does not have."""

    def __init__(self, signal: str, names: Sequence[str], where: str = "trace") -> None:
        """Name the signal, the signals there are, and the nearest of them."""
        self.signal = signal
        near = difflib.get_close_matches(signal, names, n=1)
        hint = f" (did you mean {near[0]!r}?)" if near else ""
        super().__init__(f"formula uses signal {signal!r}; the {where} has {', '.join(names) or 'none'}{hint}")


class ShortTraceError(ValueError):
    """A trace ends before the formula's horizon and no other policy was named."""

    def __init__(self, needed: int, got: int) -> None:
        """Say how many samples are needed and how many there are."""
        self.needed, self.got = needed, got
        super().__init__(
            f"needs {needed} samples, got {got} (policy='clip' or policy='interval' evaluate short traces)"
        )


class UndefinedError(ValueError):
    """A sample is NaN, or a predicate has no value (square root of a negative number, division by zero)."""


class FragmentError(ValueError):
    """A formula outside the funnel fragment (eq. 2 of the paper).

    Attributes:
        reason: which rule it breaks and what would be allowed.
        position: where in the formula's text, or None for a formula that was built by hand.
    """

    def __init__(self, what: str, position: Position | None, reason: str) -> None:
        """Build "`what` at column c is not in the funnel fragment: `reason`"."""
        self.position = position
        self.reason = reason
        place = f" at {position}" if position else ""
        super().__init__(f"{what}{place} is not in the funnel fragment: {reason}")


def _excerpt(source: str, column: int, width: int = 100) -> tuple[str, str]:
    """At most `width` characters of `source` around `column`, and the blanks that lead to it."""
    start = max(0, column - 1 - width // 2) if len(source) > width else 0
    shown = source[start : start + width].replace("\t", " ")
    return shown, " " * (column - 1 - start)
