"""The process of one item, and the processes below it: their memory, as a user and a person write it, and their end.

On Linux the supervisor inherits each process whose parent ends (`adopt`). Elsewhere a process that has left both its
parent and its group escapes.
"""

import ctypes
import faulthandler
import math
import os
import pickle
import re
import signal
import sys
import time
import traceback
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TextIO

import psutil
from pydantic import BeforeValidator, Field

from stlbench.contract import cause

_GROUPS = Path("/sys/fs/cgroup")  # the limits of a container, or of a job of a cluster, on Linux
_SHARE = 0.9  # share of the machine's memory for all cells together, by default

_AMOUNT = re.compile(r"([0-9]+(?:\.[0-9]+)?) *([KMGT])(?:i?B)?", re.IGNORECASE)


def _read(value: Any) -> Any:
    """4G means 4 GiB, as for most programs. A number is one of bytes."""
    if not isinstance(value, str):
        return value
    match = _AMOUNT.fullmatch(value.strip())
    if match is None:
        raise ValueError("should be an amount of memory, as in 4G, 512M or 1.5GiB")
    amount = float(match[1]) * 1024 ** (1 + "KMGT".index(match[2].upper()))
    if not math.isfinite(amount):
        raise ValueError("should be an amount of memory that a machine can have, as in 4G")
    return int(amount)


Memory = Annotated[int, BeforeValidator(_read), Field(ge=2**20)]  # bytes, written as 4G, 512M or 1.5GiB


def share(jobs: int) -> int:
    """The default number of bytes for each of `jobs` cells at a time."""
    return int(_SHARE * min([psutil.virtual_memory().total, *allowed(_GROUPS, _own_groups())]) / jobs)


def allowed(root: Path, own: str) -> list[int]:
    """The limits in bytes of the control groups in `own`, a text as /proc/self/cgroup, and of those above them."""
    limits = list[int]()
    for line in own.splitlines():
        _, kinds, path = line.split(":", 2)
        if kinds in ("", "memory"):
            top, name = (root / "memory", "memory.limit_in_bytes") if kinds else (root, "memory.max")
            group = top / path.lstrip("/")
            for folder in (group, *(above for above in group.parents if above.is_relative_to(top))):
                with suppress(OSError, ValueError):  # "max" is no limit
                    limits.append(int((folder / name).read_text()))
    return limits


def _own_groups() -> str:
    with suppress(OSError):
        return Path("/proc/self/cgroup").read_text()
    return ""


def text_of(size: int) -> str:
    return f"{size / 2**30:.1f} GiB" if size >= 2**30 else f"{size / 2**20:.0f} MiB"


_PARENT_DEATH_SIGNAL, _CHILD_SUBREAPER = 1, 36  # as <linux/prctl.h> numbers them

_PATIENCE = 10.0
"""Seconds for which processes are killed again and again, since new ones may start, and the kernel may hold some."""


def adopt() -> None:
    """Become the parent of processes below this one that lose theirs."""
    _control(_CHILD_SUBREAPER, 1)


def die_with(parent: int) -> None:
    """End when the parent process does; at once if it has ended already."""
    _control(_PARENT_DEATH_SIGNAL, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)


def _control(option: int, value: int) -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


def memory_below(limit: int) -> int:
    """Bytes that all processes below this one take. Beyond the limit, shared memory is divided, which takes longer."""
    processes = psutil.Process().children(recursive=True)
    resident = sum(_resident(process) for process in processes)
    return resident if resident <= limit else sum(_proportional(process) for process in processes)


def _resident(process: psutil.Process) -> int:
    with suppress(psutil.Error):
        return int(process.memory_info().rss)
    return 0


def _proportional(process: psutil.Process) -> int:
    with suppress(psutil.Error):
        sizes = process.memory_full_info()._asdict()
        return int(sizes.get("pss") or sizes["uss"]) + int(sizes.get("swap", 0))
    return 0


def end_below(group: int) -> None:
    """Kill all processes below this one, and wait for their end; also the group, on systems without `adopt`."""
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
    """Kill the children of this process that a killed child has left: all but the known ones."""
    for process in psutil.Process().children():
        if process.pid not in known:
            with suppress(psutil.Error):
                process.kill()


def _reap() -> bool:
    """Reap children that have ended; whether others are left."""
    while True:
        try:
            child, _ = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return False
        if child == 0:
            return True


class Answer(NamedTuple):
    value: bytes  # pickled: what it returned
    reason: str = ""  # the exception in one line, if it raised one
    details: str = ""


def run(work: bytes, supervisor: int, answer: int, output: int | None) -> None:
    """Call the item, pickled in `work`, write an `Answer` to the descriptor `answer`, and end this process.

    It ends with the process `supervisor`. Standard output and error go to the descriptor `output`, if there is one.
    """
    die_with(supervisor)
    os.setpgid(0, 0)  # not a session of its own: Linux shares out processor time by sessions
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    _redirect(output)
    _first_victim()
    _reseed()
    own = os.getpid()
    result = _called(work)
    if os.getpid() != own:
        os._exit(1)  # a process that the item forked has come back from it; the item's own process answers
    _flush()
    _write(answer, pickle.dumps(result))
    os._exit(0)


def _redirect(output: int | None) -> None:
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    if output is not None:
        for descriptor in (1, 2):
            os.dup2(output, descriptor)
        sys.stdout, sys.stderr = _written_to(1), _written_to(2)
        faulthandler.enable(sys.stderr)  # a crash of compiled code then says its place


def _written_to(descriptor: int) -> TextIO:
    """A stream that writes line by line, so that little is lost in a crash. An old stream could seek in its file."""
    return open(descriptor, "w", buffering=1, encoding="utf-8", errors="backslashreplace", closefd=False)


def _first_victim() -> None:
    """If the machine runs out of memory, Linux shall kill this process, not the one that records results."""
    with suppress(OSError), open("/proc/self/oom_score_adj", "w") as file:
        file.write("500")


def _reseed() -> None:
    """Python reseeds its own generator after a fork; NumPy does not."""
    if "numpy" in sys.modules:
        import numpy as np

        np.random.seed()  # noqa: NPY002


def _called(work: bytes) -> Answer:
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
        ctypes.CDLL(None).fflush(None)  # texts that compiled code has printed


def _write(descriptor: int, data: bytes) -> None:
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(descriptor, rest) :]
