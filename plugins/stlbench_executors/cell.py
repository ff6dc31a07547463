"""What happens in the process of one item: it is called, and its answer written to a file."""

from __future__ import annotations

import ctypes
import faulthandler
import os
import pickle
import signal
import sys
import traceback
from contextlib import suppress
from typing import NamedTuple, TextIO

from stlbench.contract import cause
from stlbench_executors import tree


class Answer(NamedTuple):
    """What an item that came to an end says."""

    value: bytes
    """Pickled: what it returned."""
    reason: str = ""
    """The exception in one line, where it raised one."""
    details: str = ""


def run(work: bytes, keeper: int, answer: int, output: int | None) -> None:
    """Call the item and end this process.

    Args:
        work: pickled: a function and what to call it with.
        keeper: number of the process that this one is to end with.
        answer: descriptor of a file that takes an `Answer`, pickled.
        output: descriptor that takes standard output and error; None leaves them as they are.
    """
    tree.die_with(keeper)
    os.setpgid(0, 0)  # not a session of its own: Linux shares out processor time by sessions
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    _redirect(output)
    _first_victim()
    _draw_anew()
    own = os.getpid()
    said = _called(work)
    if os.getpid() != own:
        os._exit(1)  # a process that the item forked has come back from it; the item's own process answers
    _flush()
    _write(answer, pickle.dumps(said))
    os._exit(0)


def _redirect(output: int | None) -> None:
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    if output is not None:
        for descriptor in (1, 2):
            os.dup2(output, descriptor)
        sys.stdout, sys.stderr = _written_to(1), _written_to(2)
        faulthandler.enable(sys.stderr)  # where a crash happened


def _written_to(descriptor: int) -> TextIO:
    """Line by line, so that little is lost in a crash. The streams of before may be of a file, in which they would look
    for their place."""
    return open(descriptor, "w", buffering=1, encoding="utf-8", errors="backslashreplace", closefd=False)


def _first_victim() -> None:
    """Where the machine runs out of memory, Linux ends this process rather than the one that records results."""
    with suppress(OSError), open("/proc/self/oom_score_adj", "w") as file:
        file.write("500")


def _draw_anew() -> None:
    """NumPy's global generator, which all forked processes would have alike; Python does so with its own."""
    if "numpy" in sys.modules:
        import numpy as np

        np.random.seed()  # noqa: NPY002


def _called(work: bytes) -> Answer:
    """All that may fail is in here: reading the item, running it, writing what it returns."""
    try:
        function, item = pickle.loads(work)  # noqa: S301 - from our own parent
        return Answer(pickle.dumps(function(item)))
    except BaseException as error:
        return Answer(b"", cause(error), traceback.format_exc())


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        with suppress(Exception):
            stream.flush()
    with suppress(Exception):
        ctypes.CDLL(None).fflush(None)  # what compiled code has printed


def _write(descriptor: int, data: bytes) -> None:
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(descriptor, rest) :]
