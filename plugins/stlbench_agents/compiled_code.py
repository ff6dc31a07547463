"""Where the compiled code of these agents is kept, and whether it is there. Imports no Numba, which takes a while.

Numba keeps what it compiled beside a function's file, and looks at the age of that file alone: where another file
changes whose functions it calls, it would go on with the old ones. So there is a folder for each state of the sources.
"""

from __future__ import annotations

import hashlib
import os
import sys
from functools import cache
from importlib.metadata import version
from pathlib import Path

__all__ = ["folder", "is_ready", "note_ready"]


@cache
def folder() -> Path:
    """For this state of the sources, Python, Numba and machine; under NUMBA_CACHE_DIR where that is set."""
    state = hashlib.sha256(f"{sys.version} {version('numba')} {version('llvmlite')} {os.uname()}".encode())
    for path in sorted(Path(__file__).parent.glob("*.py")):
        state.update(path.read_bytes())
    caches = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(os.environ.get("NUMBA_CACHE_DIR") or Path(caches) / "stlbench") / f"agents-{state.hexdigest()[:16]}"


def is_ready(part: str) -> bool:
    """Whether this machine has compiled a part: the code of a learner."""
    return (folder() / part).exists()


def note_ready(part: str) -> None:
    """It has now."""
    folder().mkdir(parents=True, exist_ok=True)
    (folder() / part).touch()
