"""Formula text to tokens: a stream of them that reads numbers and intervals or fails at the place."""

import math
import re
from decimal import Decimal, DecimalException
from typing import NamedTuple, NoReturn

from stlbench.stl.errors import Position, StlSyntaxError, shorten
from stlbench.stl.language.expressions import DOTS, OPERATOR_WORDS
from stlbench.stl.language.notations import remedy
from stlbench.stl.language.syntax import MAX_STEP

#: characters that a formula's text may have
MAX_LENGTH = 200_000
#: how far seconds / dt may be from a whole number of steps: both are written with few digits
_ROUNDING = Decimal("1e-6")
_NUMBER = re.compile(r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
#: the last four of the first row are of other languages, and refused as a whole
_SYMBOLS = ("<->", "<=>", "==>", "=>", "=<", "**", "<=", ">=", "==", "!=", "->", "&&", "||", *"+-*/^()[],<>=!&|")
_ALIASES = {"&&": "&", "||": "|", "^": "**", **OPERATOR_WORDS}


class Token(NamedTuple):
    """`kind` is number, name, symbol or end; `symbol` is the operator in its one spelling, `text` as written."""

    kind: str
    text: str
    symbol: str
    position: Position

    @property
    def shown(self) -> str:
        return "the end of the formula" if self.kind == "end" else repr(self.text)


def tokenize(text: str) -> list[Token]:
    """Tokens of `text`, ending with one of kind `end`."""
    if not isinstance(text, str):
        raise TypeError(f"parse takes a formula's text, got {type(text).__name__} {shorten(repr(text)[:1000])}")
    if len(text) > MAX_LENGTH:
        before = text[:MAX_LENGTH].splitlines()
        place = Position(len(before), len(before[-1]) + 1)
        limit = f"the end of the formula (at most {MAX_LENGTH:,} characters)"
        raise StlSyntaxError("\n".join(before), place, limit, f"{len(text):,} characters")
    tokens: list[Token] = []
    lines = text.splitlines() or [""]
    for line, source in enumerate(lines, start=1):
        column = 0
        while column < len(source):
            if source[column].isspace():
                column += 1
                continue
            if source[column] == "#":  # a comment
                break
            token = _token(text, source, column, Position(line, column + 1))
            tokens.append(token)
            column += len(token.text)
    tokens.append(Token("end", "", "", Position(len(lines), len(lines[-1]) + 1)))
    return tokens


def _token(text: str, source: str, column: int, position: Position) -> Token:
    if number := _NUMBER.match(source, column):
        return Token("number", number[0], "", position)
    if word := _name(source, column):
        symbol = _ALIASES.get(word, "")
        return Token("symbol" if symbol else "name", word, symbol, position)
    for spelling in _SYMBOLS:
        if source.startswith(spelling, column):
            return Token("symbol", spelling, _ALIASES.get(spelling, spelling), position)
    raise refused(text, position, "a name, a number or an operator", repr(source[column]))


def _name(source: str, column: int) -> str:
    """The longest name that begins at `column`, with marks that combine with letters; in `x²` and `x·y` it is x."""
    end = column
    if source[column].isidentifier():
        end += 1
        while end < len(source) and source[end] not in DOTS and f"_{source[end]}".isidentifier():
            end += 1
    return source[column:end]


def refused(text: str, position: Position, expected: str, found: str, otherwise: str | None = None) -> StlSyntaxError:
    """The error of text that is wrong at `position`, with a remedy: of a notation that is known, or `otherwise`."""
    line = (text.splitlines() or [""])[position.line - 1]
    return StlSyntaxError(text, position, expected, found, remedy(line, position.column, otherwise))


class TokenStream:
    """Moves through the tokens of `text`; `dt` (seconds) turns interval ends from seconds into steps."""

    def __init__(self, text: str, dt: float | None) -> None:
        self.text, self.dt = text, dt
        self.tokens = tokenize(text)
        self.next = 0

    @property
    def token(self) -> Token:
        return self.tokens[self.next]

    @property
    def second(self) -> Token:
        return self.tokens[min(self.next + 1, len(self.tokens) - 1)]

    def take(self) -> Token:
        self.next += 1
        return self.tokens[self.next - 1]

    def at(self, symbol: str) -> bool:
        return self.token.symbol == symbol

    def expect(self, symbol: str, or_else: str = "") -> Token:
        """Take this operator, or fail saying `or_else`."""
        if not self.at(symbol):
            self.fail(or_else or repr(symbol))
        return self.take()

    def fail(
        self, expected: str, found: str | None = None, position: Position | None = None, remedy: str | None = None
    ) -> NoReturn:
        """Raise StlSyntaxError at the next token or at `position`."""
        token = self.token
        raise refused(self.text, position or token.position, expected, found or token.shown, remedy)

    def number(self) -> float:
        token = self.token
        if token.kind != "number":
            self.fail("a number")
        value = float(token.text)
        if not math.isfinite(value):
            self.fail("a finite number")
        if token.text.isdigit() and Decimal(token.text) != Decimal(value):
            self.fail("a whole number that is a float, as all up to 2**53 are (subtract the first value from all)")
        self.take()
        return value

    def interval(self) -> tuple[int, int]:
        opening = self.expect("[")
        first, a = self.end_of_interval()
        self.expect(",")
        last, b = self.end_of_interval()
        self.expect("]")
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
            given = Decimal(token.text)
            steps = given if self.dt is None else given / Decimal(repr(self.dt))
            vanishes = not steps and bool(given)  # by an exponent of seven digits
        except DecimalException:  # of twenty digits
            vanishes = True
        if vanishes:
            self.fail("a number of at least 1e-300, or 0", token.shown, token.position)
        whole = int(steps.to_integral_value())
        if whole > MAX_STEP:  # by a digit that the float above has lost
            self.fail(f"an interval end of at most {MAX_STEP} steps", token.shown, token.position)
        may_round = self.dt is not None and whole > 0  # the difference is no more exact
        if steps != whole and not (may_round and abs(steps - whole) <= _ROUNDING):
            rule = "a whole number of steps" + (f" of dt={self.dt:g} seconds" if self.dt else "")
            hint = f"{token.text} seconds = {steps:.12g} steps" if self.dt else f"{token.text!r} (give dt or --time)"
            self.fail(rule, hint, token.position)
        return token.text, whole
