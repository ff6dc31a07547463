"""A list of formulas as text: one per line, with comments and line breaks."""

from __future__ import annotations

from collections.abc import Iterator

from stlbench.stl.errors import StlSyntaxError
from stlbench.stl.language.syntax import BETWEEN
from stlbench.stl.language.tokens import Token, tokenize

#: symbols that a formula can begin with; all others join a line to the one before
_BEGINS = ("(", "!", "+", "-")
_INFIX = {*BETWEEN, "W", "weak_until"}


def listed(text: str) -> Iterator[tuple[int, str]]:
    """Each formula of `text`, in one line without comments, and the line that it begins in, from 1.

    A formula goes on in the next line where a bracket is open, after an operator at the end of a line, and before an
    operator at the beginning of one.
    """
    first, parts, depth, joins = 0, list[str](), 0, False
    for number, line in enumerate(text.splitlines(), start=1):
        content = line.partition("#")[0].strip()
        if not content:
            continue
        tokens = _tokens(content)
        if parts and not (depth > 0 or joins or _goes_on(tokens)):
            yield first, " ".join(parts)
            parts, depth = [], 0
        first = first if parts else number
        parts.append(content)
        depth += sum((token.symbol in ("(", "[")) - (token.symbol in (")", "]")) for token in tokens)
        joins = bool(tokens) and _is_open(tokens[-1])
    if parts:
        yield first, " ".join(parts)


def _tokens(line: str) -> list[Token]:
    """The tokens of a line without the one for its end; none of a line that has a sign of no formula."""
    try:
        return tokenize(line)[:-1]
    except StlSyntaxError:
        return []


def _is_open(last: Token) -> bool:
    """Whether a token at the end of a line asks for more."""
    return (last.kind == "symbol" and last.symbol != ")") or last.text in ("always", "eventually", "until")


def _goes_on(tokens: list[Token]) -> bool:
    """Whether a line begins with an operator between two parts."""
    if not tokens:
        return False
    begin, second = tokens[0], tokens[1] if len(tokens) > 1 else None
    if begin.kind == "symbol":
        return begin.symbol not in _BEGINS
    return begin.text == "until" or (begin.text in _INFIX and second is not None and second.symbol == "[")
