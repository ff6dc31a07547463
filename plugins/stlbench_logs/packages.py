"""Whether the package that a log writes through is there."""

from __future__ import annotations

from importlib.util import find_spec

from stlbench.contract import Unsuitable


def require(package: str, extra: str) -> None:
    """Raises `Unsuitable` where a package is not installed, with the extra of stlbench that brings it."""
    found = find_spec(package)
    if found is None or found.origin is None:  # a folder of that name is no package
        raise Unsuitable(f'it needs the package {package}: pip install "stlbench-rl[{extra}]"')
