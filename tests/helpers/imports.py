"""What a command imports, seen in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

HEAVY = frozenset({"dm_control", "gymnasium", "matplotlib", "mujoco", "numba", "pandas", "scipy", "torch"})
"""Packages that take a tenth of a second or more to import."""

_CODE = """
import json, sys
from stlbench.cli import app
for words in json.loads(sys.argv[1]):
    try:
        app(words)
    except SystemExit as end:
        assert not end.code, (words, end.code)
print(*sorted({name.partition(".")[0] for name in sys.modules}), file=sys.stderr)
"""


def imported(*commands: Sequence[object], folder: Path) -> set[str]:
    """The top-level packages that commands have imported at their end. They are said in `folder`, and succeed."""
    said = json.dumps([list(map(str, words)) for words in commands])
    done = subprocess.run([sys.executable, "-c", _CODE, said], capture_output=True, text=True, check=True, cwd=folder)
    return set(done.stderr.splitlines()[-1].split())
