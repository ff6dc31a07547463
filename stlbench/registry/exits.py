"""Code of others that would end this process without a word, or hang: each says who it was."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import chdir, contextmanager
from types import FrameType
from typing import NoReturn

_LONG = 10.0  # seconds that an import may take without a word
_SHELL = "/bin/sh"


@contextmanager
def exits_raise() -> Iterator[None]:
    """Until the end of the block `os._exit` raises `SystemExit` in this process; in those that it forks it does not."""
    leave, own = os._exit, os.getpid()

    def refuse(status: int) -> NoReturn:
        if os.getpid() != own:
            leave(status)
        raise SystemExit(f"it called os._exit({status})")

    os._exit = refuse
    try:
        yield
    finally:
        os._exit = leave


@contextmanager
def importing(what: str) -> Iterator[None]:
    """While code of others is imported, whoever waits is told that `what` hangs, ends the process or is interrupted.

    The working directory is the same again at the end: paths that a user gives begin there.
    """
    with exits_raise(), _watched(what), chdir("."):
        try:
            with interrupts_raise():
                yield
        except KeyboardInterrupt:
            _tell(f"interrupted while {what} was imported")
            raise


@contextmanager
def interrupts_raise() -> Iterator[None]:
    """Until the end of the block a `KeyboardInterrupt` that no signal brought, but the code, raises `SystemExit`."""
    came = list[int]()
    with _noted(came):
        try:
            yield
        except KeyboardInterrupt as error:
            if came:
                raise
            raise SystemExit("it raised KeyboardInterrupt") from error


@contextmanager
def _watched(what: str) -> Iterator[None]:
    """A shell beside this process speaks if the process is gone before the end of the block, as after a crash."""
    import subprocess  # which most commands do without

    slow = threading.Timer(_LONG, _tell, [f"warning: {what} is still being imported, after {_LONG:g} s"])
    slow.daemon = True
    said = f"error: {what} ended the process as it was imported"
    words = [_SHELL, "-c", 'read -r _ || printf "%s\\n" "$0" >&2', said]
    try:
        beside = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)  # noqa: S603 - words of our own
    except OSError:  # there is no such shell, or no process more
        beside = None
    slow.start()
    try:
        yield
    finally:
        slow.cancel()
        if beside is not None:
            beside.communicate(b"\n")  # it does not mind that ctrl-C has ended the shell too


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


@contextmanager
def _noted(came: list[int]) -> Iterator[None]:
    """Note each signal by which a user interrupts this process, in its main thread, which gets them."""
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return

    def note(number: int, frame: FrameType | None) -> None:
        came.append(number)
        before(number, frame)

    signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
