"""What workers run in the tests of executors: importable, so that a spawned process finds it."""

import os
import signal
import sys
import time
from pathlib import Path


def work(item: str) -> str:
    """Do what the item says; anything else is echoed."""
    verb, _, rest = item.partition(" ")
    if verb == "raise":
        raise ValueError(rest)
    if verb == "hang":
        time.sleep(600)
    if verb == "kill":
        os.kill(os.getpid(), int(rest))
    if verb == "exit":
        os._exit(int(rest))
    if verb == "leave":
        sys.exit(rest)
    return item.upper()


def spin(item: str) -> str:
    """Hang in compiled code, where no Python signal handler runs."""
    return str(sum(range(10**13))) if item == "spin" else item


def pid(_: object) -> int:
    return os.getpid()


def slow_pid(_: object) -> int:
    time.sleep(0.3)
    return os.getpid()


def environment(name: str) -> str:
    import numpy  # noqa: F401

    return os.environ.get(name, "unset")


def interrupted(item: str) -> str:
    """Like `work`, but first send an interrupt to oneself, as ctrl-C does to all processes of a terminal."""
    os.kill(os.getpid(), signal.SIGINT)
    return work(item).lower()


def closure(_: object) -> object:
    return lambda: None


class UnreadableError(Exception):
    def __init__(self, one: int, two: int) -> None:
        super().__init__("cannot be rebuilt")


def unreadable(_: object) -> None:
    raise UnreadableError(1, 2)


def leave_pid(path: Path | None) -> None:
    """Write the process' number to the file, and stay; without a file, return."""
    if path is not None:
        path.write_text(str(os.getpid()))
        time.sleep(600)
