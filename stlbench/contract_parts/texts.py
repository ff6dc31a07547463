"""Texts of plugins, made safe to record and to show: whatever an exception's `__str__` does, however long it is."""

from __future__ import annotations

import re

__all__ = ["cause", "one_line", "printable"]

LINE, PAGE = 500, 20_000
"""The most characters of a line, and of a text of several lines."""
_NOTE = 50
"""Characters for how many are left out."""

_UNSAFE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
"""Control characters but tab and newline, marks that turn the direction of text, and halves of surrogate pairs, which
no file and no terminal takes."""


def printable(value: object, most: int = PAGE) -> str:
    """The text of anything, of at most about `most` characters: unsafe ones are escaped, what is too long lacks its
    middle. Never raises, whatever the value's `__str__` does."""
    return _UNSAFE.sub(_escaped, _shortened(_text(value), most))


def one_line(value: object) -> str:
    """The same in one line: all white space is a single space."""
    text = _text(value)
    left_out = max(0, len(text) - PAGE)
    ends = text[: PAGE // 2] + text[-PAGE // 2 :] if left_out else text  # the seam is in the middle that a line lacks
    return _UNSAFE.sub(_escaped, _shortened(" ".join(ends.split()), LINE, left_out))


def cause(error: BaseException) -> str:
    """An exception in one line: "ValueError: no such luck"."""
    return one_line(f"{_name(error)}: {_text(error)}").removesuffix(":")


def _name(error: BaseException) -> str:
    return _text(type.__dict__["__name__"].__get__(type(error)))  # a metaclass may have a `__name__` of its own


def _text(value: object) -> str:
    try:
        return str.__str__(str(value))  # a subclass of str may have methods of its own
    except BaseException as error:
        return f"(its text cannot be had, it raises {_name(error)})"


def _shortened(text: str, most: int, left_out: int = 0) -> str:
    """At most so many characters, with the number of those left out, so that it is not shortened again."""
    if len(text) <= most:
        return text
    kept = most - _NOTE
    head = kept // 4
    return f"{text[:head]} ... {len(text) - kept + left_out} characters left out ... {text[head - kept :]}"


def _escaped(found: re.Match[str]) -> str:
    return found[0].encode("unicode_escape").decode()
