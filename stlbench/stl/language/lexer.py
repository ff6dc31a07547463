"""Formula text to tokens. Spellings of one operator (`and`, `&&`, `&`) become one token."""

from __future__ import annotations

import re
from typing import NamedTuple

from stlbench.stl.errors import Position, StlSyntaxError
from stlbench.stl.language.grammar import OPERATOR_WORDS

_NUMBER = re.compile(r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_WORD = re.compile(r"\w+")
_SYMBOLS = ("**", "<=", ">=", "==", "!=", "->", "&&", "||", *"+-*/^()[],<>=!&|")
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
        StlSyntaxError: a character that starts no token.
    """
    tokens: list[Token] = []
    for line, source in enumerate(text.splitlines() or [""], start=1):
        column = 0
        while column < len(source):
            if source[column].isspace():
                column += 1
                continue
            token = _token(text, source, column, Position(line, column + 1))
            tokens.append(token)
            column += len(token.text)
    lines = text.splitlines() or [""]
    tokens.append(Token("end", "", "", Position(len(lines), len(lines[-1]) + 1)))
    return tokens


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
