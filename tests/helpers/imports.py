"""What a command imports, seen in a process of its own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

HEAVY = frozenset({"dm_control", "gymnasium", "matplotlib", "mujoco", "numba", "pandas", "scipy", "torch"})
"""Packages that take a tenth of a second or more to import."""

_CODE = """
import sys
from stlbench.cli import app
try:
    app(sys.argv[1:])
except SystemExit as end:
    assert not end.code, end.code
print(*sorted({name.partition(".")[0] for name in sys.modules}), file=sys.stderr)
"""


def imported(*words: object, folder: Path) -> set[str]:
    """The top-level packages that a command has imported at its end. It is said in `folder`, and has to succeed."""
    done = subprocess.run(
        [sys.executable, "-c", _CODE, *map(str, words)], capture_output=True, text=True, check=True, cwd=folder
    )
    return set(done.stderr.splitlines()[-1].split())
