"""A made-up distribution whose methods do, each in its own way, what a plugin should not; and how their cells end."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from cli.conftest import AGENTS, SYSTEM, TASK

__all__ = ["INNOCENT", "KINDS", "LIMIT", "Kind", "install"]

LIMIT = 400 * 2**20
"""Bytes of memory that a cell may take."""


class Kind(NamedTuple):
    """How a cell of a method misbehaves, as the body of its first step; and how it has to end."""

    body: str
    status: str
    reason: str = ""
    """A part of what is said."""
    deadline: float = 600.0


def _hangs(body: str) -> Kind:
    return Kind(body, "timeout", "no result after", deadline=3.0)


KINDS: Mapping[str, Kind] = MappingProxyType(
    {
        # 1: texts
        "raise": Kind("raise ValueError('no such luck')", "raised", "ValueError: no such luck"),
        "mute": Kind("raise Mute", "raised", "its text cannot be had"),
        "bytes": Kind("open(os.fsdecode(b'caf\\xe9'))", "raised", "caf\\udce9"),
        "escape": Kind("raise ValueError('\\x1b[2J\\x07\\x00' + 1000 * 'x')", "raised", "\\x1b[2J"),
        "leave": Kind("sys.exit('bye')", "raised", "SystemExit"),
        "interrupt": Kind("raise KeyboardInterrupt", "raised", "KeyboardInterrupt"),
        "recursion": Kind("(lambda f: f(f))(lambda f: f(f))", "raised", "RecursionError"),
        "refuse": Kind("raise Intractable(Mute())", "intractable"),
        "unfit": Kind("raise Unsuitable('\\x1b[31mred \\udcff')", "unsuitable"),
        # 2: processes
        "segfault": Kind("ctypes.string_at(0)", "killed", "signal 11"),
        "abort": Kind("os.abort()", "killed", "signal 6"),
        "exit-0": Kind("os._exit(0)", "killed", "exit code 0"),
        "exit-3": Kind("os._exit(3)", "killed", "exit code 3"),
        "term": Kind("os.kill(os.getpid(), 15); time.sleep(600)", "killed", "signal 15"),
        "group": Kind("os.killpg(os.getpgrp(), 9); time.sleep(600)", "killed", "signal 9"),
        "keeper": Kind("os.kill(os.getppid(), 9); time.sleep(600)", "killed", "watched over it"),
        "close": Kind("os.closerange(0, 1000)", "killed", "exit code 1"),
        "hang": _hangs("signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(600)"),
        "spin": _hangs("sum(range(10**13))"),
        "pause": _hangs("os.kill(os.getpid(), signal.SIGSTOP)"),
        "memory": Kind("kept = [b'x' * 2**26 for _ in range(40)]; time.sleep(600)", "killed", "memory"),
        "held": Kind("os.fork() or time.sleep(600); os._exit(0)", "killed", "exit code 0"),
        "daemons": Kind("leave_daemons()", "done"),
        "threads": Kind("leave_threads()", "done"),
        "flood": Kind("sys.stdout.write('x' * 2**22)", "done"),
        "change": Kind("change_all(); raise ValueError('changed')", "raised", "ValueError: changed"),
        # 3: what a cell says
        "nan": Kind("return np.full(arguments[0][1:, :, 0].shape, np.nan), arguments[3]", "raised", "reward is nan"),
        "shape": Kind("return np.zeros(3 + len(arguments[0])), arguments[3]", "raised", "the shape of its rewards"),
    }
)

INNOCENT = "soak-innocent"

_HEAD = '''
import ctypes, os, signal, sys, threading, time
import numpy as np
from stlbench.contract import Intractable, RewardMethod, Unsuitable


class Mute(Exception):
    def __str__(self):
        raise KeyError("no text")


def leave_daemons():
    """As daemons do: fork, leave the session, fork again; three times."""
    for _ in range(3):
        if os.fork() == 0:
            os.setsid()
            if os.fork() == 0:
                time.sleep(600)
            os._exit(0)


def leave_threads():
    for _ in range(3):
        threading.Thread(target=time.sleep, args=(600,)).start()


def change_all():
    from stlbench.simulation import referee
    os.chdir("/")
    os.umask(0o777)
    os.environ["HOME"] = "/nowhere"
    np.seterr(all="raise")
    np.mean = lambda *_, **__: 99.0
    time.perf_counter = lambda: -2187.0
    referee.score = lambda *_: None


class Innocent(RewardMethod):
    """One minus x."""
    def along(self, *arguments): return 1 - arguments[0][1:, :, 0], arguments[3]
    def describe(self): return {}
'''

_CLASS = '''

class {name}(Innocent):
    """{kind}"""
    ended = False
    def along(self, *arguments):
        if not self.ended:
            {name}.ended = True
            {body}
        return super().along(*arguments)
'''


def _name(kind: str) -> str:
    return f"Fault{kind.title().replace('-', '')}"


def install(folder: Path) -> None:
    """Write the distribution; the folder has to be on the path of whoever uses it."""
    classes = (_CLASS.format(name=_name(kind), kind=kind, body=found.body) for kind, found in KINDS.items())
    methods = _HEAD + "".join(classes)
    entries = [
        *("[stlbench.methods]", f"{INNOCENT} = soak_plugins.methods:Innocent"),
        *(f"soak-{kind} = soak_plugins.methods:{_name(kind)}" for kind in KINDS),
        *("[stlbench.tasks]", "toy-line = soak_plugins.line.system:Line"),
        *("[stlbench.agents]", "toy-agent = soak_plugins.agents:Still"),
    ]
    files = {
        "soak_plugins-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: soak-plugins\nVersion: 1.0\n",
        "soak_plugins-1.0.dist-info/entry_points.txt": "\n".join(entries),
        "soak_plugins/__init__.py": "",
        "soak_plugins/methods.py": methods,
        "soak_plugins/agents.py": AGENTS,
        "soak_plugins/line/__init__.py": "",
        "soak_plugins/line/system.py": SYSTEM,
        "soak_plugins/line/task.yaml": TASK,
    }
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
