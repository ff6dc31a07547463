"""Where the compiled code of these agents is kept, and whether it is there. Imports no Numba, which takes a while.

Numba keeps what it compiled beside a function's file, and looks at the age of that file alone: where another file
changes whose functions it calls, it would go on with the old ones. So there is a folder for each state of the sources.
"""

from __future__ import annotations

import hashlib
import os
import sys
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from tempfile import gettempdir


@cache
def folder() -> Path:
    """For this state of the sources, Python, Numba and machine; under NUMBA_CACHE_DIR where that is set."""
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
    """Whether this machine has compiled a part: the code of a learner."""
    return (folder() / part).exists()


def note_ready(part: str) -> None:
    """It has now. Where nothing can be written, each process compiles, and this says so each time."""
    with suppress(OSError):
        folder().mkdir(parents=True, exist_ok=True)
        (folder() / part).touch()
