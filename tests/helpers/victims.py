"""What workers run in the tests of executors: importable, so that a spawned process finds it."""

import ctypes
import json
import os
import signal
import subprocess
import sys
import threading
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


def where() -> dict[str, str]:
    """A process of the machine on which it is called, as facts of an item."""
    return {"process": str(os.getpid())}


def spin(item: str) -> str:
    """Hang in compiled code, where no Python signal handler runs."""
    return str(sum(range(10**13))) if item == "spin" else item


def leak(item: str) -> object:
    """Change the process as the item says; "look" tells what a change would show in."""
    if item in _LEAKS:
        _LEAKS[item]()
        return item
    return looked()


def looked() -> dict[str, object]:
    import numpy as np

    mask = os.umask(0)
    os.umask(mask)
    torch = sys.modules.get("torch")
    return {
        "seterr": np.geterr(),
        "chdir": os.getcwd(),
        "umask": mask,
        "numpy": float(np.mean([1.0, 3.0])),
        "time": time.time() > 0,
        "stlbench": UnreadableError.__name__ + signal.Signals(2).name,
        "threads": threading.active_count(),
        "environment": os.environ.get("LEAKED"),
        "dtype": str(torch.get_default_dtype()) if torch else None,
        "answer": json.dumps(1),
    }


def _threads() -> None:
    for _ in range(5):
        threading.Thread(target=time.sleep, args=(600,)).start()


def _numpy() -> None:
    import numpy as np

    np.mean = lambda *_: 99.0


_LEAKS = {
    "seterr": lambda: __import__("numpy").seterr(all="raise"),
    "chdir": lambda: os.chdir("/"),
    "umask": lambda: os.umask(0o777),
    "numpy": _numpy,
    "time": lambda: setattr(time, "time", lambda: -2187.0),
    "stlbench": lambda: setattr(UnreadableError, "__name__", "patched"),
    "threads": _threads,
    "environment": lambda: os.environ.update(LEAKED="1"),
    "dtype": lambda: sys.modules["torch"].set_default_dtype(sys.modules["torch"].float64),
    "answer": lambda: setattr(json, "dumps", lambda *_: "wrong"),
}


def load_torch() -> None:
    import torch  # noqa: F401


def family(item: str) -> object:
    """Start processes, or turn against those around."""
    verb, _, path = item.partition(" ")
    if verb == "daemon":
        _daemon(Path(path))
        return "left one"
    if verb == "held":
        if os.fork() == 0:
            time.sleep(600)
        os._exit(0)
    if verb == "group":
        os.killpg(os.getpgrp(), signal.SIGKILL)
    if verb == "keeper":
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(600)
    if verb == "stop":
        os.kill(os.getppid(), signal.SIGSTOP)
        time.sleep(600)
    if verb == "close":
        os.closerange(0, 1000)
    return item


def _daemon(path: Path) -> None:
    """As daemons do: fork, leave the session, fork again. On return it has written its number to the file."""
    reading, writing = os.pipe()
    if os.fork() == 0:
        os.setsid()
        if os.fork() == 0:
            path.write_text(str(os.getpid()))
            os.close(writing)
            time.sleep(600)
        os._exit(0)
    os.close(writing)
    os.read(reading, 1)


def eat(item: str) -> str:
    """Take so many MiB in so many processes, "300" or "100 3", and keep them."""
    size, _, processes = item.partition(" ")
    for _ in range(int(processes or 1) - 1):
        if os.fork() == 0:
            break
    kept = bytearray(b"x") * (int(size) * 2**20)
    time.sleep(600)
    return str(len(kept))


def say(item: str) -> str:
    """Write to standard output and error, from Python, from a shell and from a crash."""
    verb, _, rest = item.partition(" ")
    if verb == "much":
        for number in range(int(rest)):
            print(f"line {number:9d}")
        return "much"
    if verb == "shell":
        subprocess.run(["sh", "-c", "echo from a shell; echo and its errors >&2; cat"], check=True)
    if verb == "crash":
        print("before it")
        ctypes.string_at(0)
    if verb == "print":
        print("caf\udce9", rest)
    return item


def note_prepared() -> None:
    os.environ["PREPARED"] = str(os.getpid())


def prepared(_: object) -> tuple[str | None, int]:
    return os.environ.get("PREPARED"), os.getpid()


def fail() -> None:
    raise RuntimeError("nothing is prepared")


def crash() -> None:
    os._exit(7)


def run_threads() -> None:
    note_prepared()
    _threads()


def log(folder: Path, item: str) -> Path:
    return folder / "logs" / f"{item.partition(' ')[0] or 'none'}.log"


def pid(_: object) -> int:
    return os.getpid()


def slow_parent(_: object) -> int:
    time.sleep(0.3)
    return os.getppid()


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


def stay_once(path: Path) -> str:
    """At the first call as `leave_pid`; a later one returns."""
    if path.exists():
        return "later"
    leave_pid(path)
    return "never"


def meet(name: str) -> str:
    """Return when there are as many others in the folder as it is named: only where all run at the same time."""
    path = Path(name)
    path.touch()
    while len(list(path.parent.iterdir())) < int(path.parent.name):
        time.sleep(0.01)
    return path.name
