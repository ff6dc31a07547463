"""The processes below this one: what memory they take, and their end. Theirs is the tree of one cell.

On Linux a process below whose own parent ends is given to this one (`adopt`), so none is lost, whatever session or
group it has put itself into. Elsewhere one that has left both its parent and its group is not found.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from collections.abc import Collection
from contextlib import suppress

import psutil

_PARENT_DEATH_SIGNAL, _CHILD_SUBREAPER = 1, 36
"""From <linux/prctl.h>."""

_PATIENCE = 10.0
"""Seconds for which processes are killed again that were started meanwhile, or that the kernel holds."""


def adopt() -> None:
    """From now on, processes below this one that lose their parent are its children."""
    _control(_CHILD_SUBREAPER, 1)


def die_with(parent: int) -> None:
    """End when the parent does, whose number it is; at once where it has ended."""
    _control(_PARENT_DEATH_SIGNAL, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)


def _control(option: int, value: int) -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


def memory_below(limit: int) -> int:
    """Bytes that all processes below this one take. Looks closely only where they seem to take more than the limit:
    what they share with each other and with the process that they were forked from then counts in parts."""
    processes = psutil.Process().children(recursive=True)
    resident = sum(_resident(process) for process in processes)
    return resident if resident <= limit else sum(_proportional(process) for process in processes)


def _resident(process: psutil.Process) -> int:
    with suppress(psutil.Error):
        return int(process.memory_info().rss)
    return 0


def _proportional(process: psutil.Process) -> int:
    with suppress(psutil.Error):
        found = process.memory_full_info()._asdict()
        return int(found.get("pss") or found["uss"]) + int(found.get("swap", 0))
    return 0


def end_below(group: int) -> None:
    """Kill all processes below this one, and wait until they have ended; where `adopt` does nothing, also the group."""
    if sys.platform != "linux":
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(group, signal.SIGKILL)
    end = time.monotonic() + _PATIENCE
    while _reap() and time.monotonic() < end:
        for process in psutil.Process().children(recursive=True):
            with suppress(psutil.Error):
                process.kill()
        time.sleep(0.001)


def end_strays(known: Collection[int]) -> None:
    """Kill the children of this process that are not among the known: what a child that was killed has left."""
    for process in psutil.Process().children():
        if process.pid not in known:
            with suppress(psutil.Error):
                process.kill()


def _reap() -> bool:
    """Take note of children that have ended; whether there are others."""
    while True:
        try:
            child, _ = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return False
        if child == 0:
            return True
