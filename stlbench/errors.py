"""What a user did wrong, as one clear line."""

from __future__ import annotations

import errno
import sqlite3
from collections.abc import Iterable
from difflib import get_close_matches

__all__ = ["UsageError", "did_you_mean", "is_disk_full"]


class UsageError(ValueError):
    """Bad input of a user: shown as one line, exit code 2, never a traceback."""


def is_disk_full(error: BaseException | None) -> bool:
    """Whether an error, or what caused it, is that a disk or a quota is full."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
            return True
        if isinstance(error, sqlite3.Error) and getattr(error, "sqlite_errorcode", 0) & 0xFF == sqlite3.SQLITE_FULL:
            return True
        error = error.__cause__
    return False


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The end of a message about an unknown name: "; did you mean 'funnel'?" or "; there are: flag, funnel"."""
    names = sorted(known)
    close = get_close_matches(name, names, n=1, cutoff=0.5)
    if close:
        return f"; did you mean '{close[0]}'?"
    return f"; there are: {', '.join(names)}" if names else "; there are none"
