"""A mistake of the user, as one clear line."""

import errno
import re
import sqlite3
from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path
from types import ModuleType

import stlbench

NO_SPACE = (errno.ENOSPC, errno.EDQUOT)
"""Errors of a disk, or a quota, that is full."""


class UsageError(ValueError):
    """Bad input of a user: shown as one line, exit code 2, never a traceback.

    The system's message on a file loses its number, and a path that was said already.
    """

    def __init__(self, message: str = "") -> None:
        super().__init__(_OF_SYSTEM.sub(_said_once, message))


_OF_SYSTEM = re.compile(r"\[Errno -?\d+\] (?P<what>[^:\[]+)(?P<where>: (?P<quote>['\"])(?P<path>.*?)(?P=quote))?")
"""An `OSError` as Python writes it: "[Errno 2] No such file or directory: 'a.csv'"."""


def _said_once(match: re.Match[str]) -> str:
    path = match["path"]
    said = path is not None and path in match.string[: match.start()]
    return match["what"] + ("" if said else match["where"] or "")


class DiskFull(UsageError):
    """stlbench cannot write a file of its own, as the disk or a quota is full: exit code 74. A plugin raises none."""


def unwritable(said: str, error: OSError | sqlite3.Error) -> UsageError:
    """The error where stlbench cannot write a file, with the cause after what is `said`; a `DiskFull` where there
    is no space for it."""
    if isinstance(error, OSError):
        is_full = error.errno in NO_SPACE
    else:
        is_full = getattr(error, "sqlite_errorcode", 0) & 0xFF == sqlite3.SQLITE_FULL
    return (DiskFull if is_full else UsageError)(f"{said}: {error}")


_WORDS = {
    r"(Value error|Assertion failed), ": "",
    r"Field required": "must be given",
    r"Input should be greater than or equal to ": "should be at least ",
    r"Input should be greater than ": "should be more than ",
    r"Input should be less than or equal to ": "should be at most ",
    r"Input should be a valid number.*": "should be a number",
    r"Input should be a valid integer.*": "should be a whole number",
    r"Input should be a valid boolean.*": "should be true or false",
    r"Input should be a valid string.*": "should be a text",
    r"Input should be a (valid )?(dictionary|mapping|object).*": "expected a mapping, {key: value}",
    r"Input should be a valid (tuple|list).*": "expected a list",
    r"Input is not a valid path.*": "should be a path",
    r"\w+ should have at least 1 .*": "should not be empty",
    r"\w+ should have at (least|most) (\d+) .*": r"should have at \1 \2 entries",
    r"(Input|String) should ": "should ",
}
"""How Pydantic begins to say a rule -> how stlbench says it."""


def in_words(message: str) -> str:
    """Pydantic's message on a value, in our words: "Input should be greater than 0" -> "should be more than 0"."""
    for begin, words in _WORDS.items():
        if re.match(begin, message):
            return re.sub(begin, words, message, count=1)
    return message


def did_you_mean(name: str, known: Iterable[str], few: Iterable[str] = ()) -> str:
    """The end of a message about an unknown name: "; did you mean 'funnel'?" or "; there are: flag, funnel".

    Where none is close, it lists the `few`, if there are any, in place of all.
    """
    names = sorted(known)
    close = get_close_matches(name, names, n=1, cutoff=0.5)
    if close:
        return f"; did you mean '{close[0]}'?"
    listed = list(few) or names
    return f"; there are: {', '.join(listed)}" if listed else "; there are none"


def counted(number: int, what: str) -> str:
    """A number of things: "1 cell", "3 cells"."""
    return f"{number} {what}{'' if number == 1 else 's'}"


# ------------------------------------------------------------------------------------------ texts of plugins, made safe


LINE, PAGE = 500, 20_000
"""The most characters of a line, and of a text of several lines."""
_NOTE = 50
"""Characters for how many are left out."""

UNSAFE = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u180e\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\ud800-\udfff\ufeff"
    "\ufff9-\ufffb\U0001bca0-\U0001bca3\U0001d173-\U0001d17a\U000e0000-\U000e007f]"
)
"""Control characters but tab and newline, what turns the direction of text, breaks lines or is not seen, and halves of
surrogate pairs, which no file and no terminal takes. The joiners U+200C and U+200D, which some scripts need, stay."""


def printable(value: object, most: int = PAGE) -> str:
    """The text of anything, of at most about `most` characters: unsafe ones are escaped, what is too long lacks its
    middle. Never raises, whatever the value's `__str__` does."""
    return UNSAFE.sub(_escaped, _shortened(_text(value), most))


def one_line(value: object, most: int = LINE) -> str:
    """The same in one line: all white space is a single space."""
    text = _text(value)
    left_out = max(0, len(text) - PAGE)
    ends = text[: PAGE // 2] + text[-PAGE // 2 :] if left_out else text  # the seam is in the middle that a line lacks
    return UNSAFE.sub(_escaped, _shortened(" ".join(ends.split()), most, left_out))


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


def _escaped(match: re.Match[str]) -> str:
    return match[0].encode("unicode_escape").decode()


# ---------------------------------------------------------------------- another package in place of this one


DISTRIBUTION = "stlbench-rl"
"""The name to install for this package. `stlbench.DISTRIBUTION` has the same value where the package is this one."""


def foreign(package: ModuleType = stlbench) -> str | None:
    """The place of another project's `stlbench` and how to mend it, in one line; None where `package` is this one.

    Where both are installed, their files share a folder, and the last one installed has the `__init__`.
    """
    if getattr(package, "DISTRIBUTION", None) == DISTRIBUTION:
        return None
    place = Path(package.__file__).parent if package.__file__ else next(iter(package.__path__), "an unknown place")
    return (
        f"the package stlbench in {place} is not that of {DISTRIBUTION}: the distribution 'stlbench' is another "
        f"project; pip uninstall stlbench, then pip install --force-reinstall --no-deps {DISTRIBUTION}"
    )
