"""What is installed where items run: the same as where they come from, or it is another program that runs them."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from contextlib import suppress
from importlib.metadata import distributions

PYTHON = "Python"


def installed() -> dict[str, str]:
    """Versions: of Python without its last number, of stlbench, and of every distribution with a plugin for it."""
    found = {PYTHON: ".".join(platform.python_version_tuple()[:2])}
    for distribution in distributions():
        with suppress(Exception):  # one whose files are damaged has no plugin that could be used
            if "[stlbench." in (distribution.read_text("entry_points.txt") or ""):
                found.setdefault(distribution.name, distribution.version)  # the first on the path counts
    return found


def difference(there: Mapping[str, str], here: Mapping[str, str]) -> str:
    """What is not alike, for a person: "stlbench-rl is 1.2.0 there, and here 1.3.0"; empty where all is."""
    return "; ".join(
        f"{name} is {there.get(name, 'not installed')} there, and here {here.get(name, 'not installed')}"
        for name in sorted(there.keys() | here.keys())
        if there.get(name) != here.get(name)
    )
