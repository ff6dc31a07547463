"""The folder of compiled code, and agents with compiled code. Imports no Numba, which takes a while.

Numba stores compiled code with a function's file and checks the age of that file alone. If another file changes whose
functions it calls, Numba goes on with the old ones. So there is a folder for each state of the sources.
"""

from __future__ import annotations

import hashlib
import os
import sys
from abc import abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from tempfile import gettempdir

from stlbench.contract import Agent


@cache
def folder() -> Path:
    """The folder for this state of the sources, Python, Numba and machine; under NUMBA_CACHE_DIR if that is set."""
    state = hashlib.sha256(f"{sys.version} {version('numba')} {version('llvmlite')} {os.uname()}".encode())
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        state.update(path.read_bytes())
    return _caches() / f"agents-{state.hexdigest()[:16]}"


def _caches() -> Path:
    named = os.environ.get("NUMBA_CACHE_DIR")
    if named:
        return Path(named)
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "stlbench"
    except RuntimeError:  # a user without a home, as in some containers
        return Path(gettempdir()) / "stlbench"


def is_ready(part: str) -> bool:
    return (folder() / part).exists()


def note_ready(part: str) -> None:
    """Note that it has; if nothing can be written, each process compiles again."""
    with suppress(OSError):
        folder().mkdir(parents=True, exist_ok=True)
        (folder() / part).touch()


@dataclass(frozen=True, kw_only=True)
class CompiledAgent(Agent):
    """An agent with code that is compiled once on each machine."""

    @property
    @abstractmethod
    def compiled_part(self) -> str:
        """The part of the code that it needs."""

    @abstractmethod
    def compile(self) -> None:
        """Compile the part, or load it from the disk."""

    def uncompiled(self) -> Callable[[], None] | None:
        return None if is_ready(self.compiled_part) else self.preload

    def preload(self) -> None:
        self.compile()
        note_ready(self.compiled_part)
