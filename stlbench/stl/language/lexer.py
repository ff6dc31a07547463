"""Formula text to tokens. Spellings of one operator (`and`, `&&`, `&`) become one token."""

from __future__ import annotations

import re
from typing import NamedTuple

from stlbench.stl.errors import Position, StlSyntaxError, shorten
from stlbench.stl.language.grammar import OPERATOR_WORDS

#: characters that a formula's text may have
MAX_LENGTH = 200_000
_NUMBER = re.compile(r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_WORD = re.compile(r"\w+")
_SYMBOLS = ("<->", "**", "<=", ">=", "==", "!=", "->", "&&", "||", *"+-*/^()[],<>=!&|")
_ALIASES = {"&&": "&", "||": "|", "^": "**", **OPERATOR_WORDS}


class Token(NamedTuple):
    """`kind` is number, name, symbol or end; `symbol` is the operator in its one spelling, `text` as written."""

    kind: str
    text: str
    symbol: str
    position: Position

    @property
    def shown(self) -> str:
        """The token as a message names it."""
        return "the end of the formula" if self.kind == "end" else repr(self.text)


def tokenize(text: str) -> list[Token]:
    """Tokens of `text`, ending with one of kind `end`.

    Raises:
        StlSyntaxError: a character that starts no token, or more than `MAX_LENGTH` characters.
        TypeError: `text` is no text.
    """
    _check_text(text)
    tokens: list[Token] = []
    lines = text.splitlines() or [""]
    for line, source in enumerate(lines, start=1):
        column = 0
        while column < len(source):
            if source[column].isspace():
                column += 1
                continue
            token = _token(text, source, column, Position(line, column + 1))
            tokens.append(token)
            column += len(token.text)
    tokens.append(Token("end", "", "", Position(len(lines), len(lines[-1]) + 1)))
    return tokens


def _check_text(text: str) -> None:
    if not isinstance(text, str):
        raise TypeError(f"parse takes a formula's text, got {type(text).__name__} {shorten(repr(text)[:1000])}")
    if len(text) > MAX_LENGTH:
        before = text[:MAX_LENGTH].splitlines()
        place = Position(len(before), len(before[-1]) + 1)
        limit = f"the end of the formula (at most {MAX_LENGTH:,} characters)"
        raise StlSyntaxError("\n".join(before), place, limit, f"{len(text):,} characters")


def _token(text: str, source: str, column: int, position: Position) -> Token:
    if number := _NUMBER.match(source, column):
        return Token("number", number[0], "", position)
    word = _WORD.match(source, column)
    if word and word[0].isidentifier():
        symbol = _ALIASES.get(word[0], "")
        return Token("symbol" if symbol else "name", word[0], symbol, position)
    for spelling in _SYMBOLS:
        if source.startswith(spelling, column):
            return Token("symbol", spelling, _ALIASES.get(spelling, spelling), position)
    raise StlSyntaxError(text, position, "a name, a number or an operator", repr(source[column]))
