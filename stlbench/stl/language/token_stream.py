"""The tokens of a formula one by one: look at the next, take it, read numbers and intervals, or fail right there."""

from __future__ import annotations

import math
from decimal import Decimal, DecimalException
from typing import NoReturn

from stlbench.stl.errors import Position, StlSyntaxError
from stlbench.stl.language.lexer import Token, tokenize
from stlbench.stl.language.syntax import MAX_STEP

#: how far seconds / dt may be from a whole number of steps: both are written with few digits
_ROUNDING = Decimal("1e-6")


class TokenStream:
    """Moves through the tokens of `text`; `dt` (seconds) turns interval ends from seconds into steps."""

    def __init__(self, text: str, dt: float | None) -> None:
        self.text, self.dt = text, dt
        self.tokens = tokenize(text)
        self.next = 0

    @property
    def token(self) -> Token:
        """The next token."""
        return self.tokens[self.next]

    @property
    def second(self) -> Token:
        """The token after the next, or the end."""
        return self.tokens[min(self.next + 1, len(self.tokens) - 1)]

    def take(self) -> Token:
        """Move past the next token and return it."""
        self.next += 1
        return self.tokens[self.next - 1]

    def at(self, symbol: str) -> bool:
        """Whether the next token is this operator."""
        return self.token.symbol == symbol

    def expect(self, symbol: str, or_else: str = "") -> Token:
        """Take this operator, or fail saying `or_else`."""
        if not self.at(symbol):
            self.fail(or_else or repr(symbol))
        return self.take()

    def fail(self, expected: str, found: str | None = None, position: Position | None = None) -> NoReturn:
        """Raise StlSyntaxError at the next token or at `position`."""
        token = self.token
        raise StlSyntaxError(self.text, position or token.position, expected, found or token.shown)

    def number(self) -> float:
        """Take a finite number."""
        token = self.token
        if token.kind != "number":
            self.fail("a number")
        value = float(token.text)
        if not math.isfinite(value):
            self.fail("a finite number")
        self.take()
        return value

    def interval(self) -> tuple[int, int]:
        """Take `[a,b]`, in steps."""
        opening = self.expect("[")
        ends = [self.end_of_interval()]
        self.expect(",")
        ends.append(self.end_of_interval())
        self.expect("]")
        (first, a), (last, b) = ends
        if a > b:
            self.fail("an interval [a,b] with a <= b", f"[{first},{last}]", opening.position)
        return a, b

    def end_of_interval(self) -> tuple[str, int]:
        """One end as written, and in steps: exactly a whole number, or with dt a multiple of it."""
        token = self.token
        if self.at("-"):
            self.fail("an interval end that is at least 0")
        if self.number() > MAX_STEP * (self.dt or 1):
            self.fail(f"an interval end of at most {MAX_STEP} steps", token.shown, token.position)
        try:
            steps = Decimal(token.text) if self.dt is None else Decimal(token.text) / Decimal(repr(self.dt))
        except DecimalException:  # an exponent of twenty digits
            self.fail("a number of at least 1e-300, or 0", token.shown, token.position)
        whole = int(steps.to_integral_value())
        if steps != whole if self.dt is None else abs(steps - whole) > _ROUNDING:  # a difference would be rounded
            rule = "a whole number of steps" + (f" of dt={self.dt:g} seconds" if self.dt else "")
            hint = f"{token.text} seconds = {steps:.12g} steps" if self.dt else f"{token.text!r} (give dt for seconds)"
            self.fail(rule, hint, token.position)
        return token.text, whole
