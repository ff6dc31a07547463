"""The entry points of the installed distributions, of which one that is broken makes none of the others fail."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from importlib.metadata import Distribution, EntryPoint, distributions

from stlbench.errors import cause, one_line


def entries(group: str, warn: Callable[[str], None]) -> Iterator[tuple[str, str, str, EntryPoint]]:
    """Name, distribution, version and entry point of each plugin of a group; `warn` is told what cannot be read.

    Like `importlib.metadata.entry_points`, which one distribution with a broken file makes fail for all.
    """
    seen = set[str]()
    for distribution in distributions():
        try:
            if group not in (distribution.read_text("entry_points.txt") or ""):
                continue
            name, version = one_line(distribution.metadata["Name"] or ""), one_line(distribution.version)
            if not name:
                raise ValueError("it has no name")
            found = tuple(distribution.entry_points.select(group=group))
        except Exception as error:
            warn(f"{_place(distribution)}: a distribution there cannot be read: {one_line(error)}")
            continue
        if name not in seen:  # the first on the path shadows others of its name
            seen.add(name)
            yield from ((entry.name, name, version, entry) for entry in found)


def damaged() -> Iterator[str]:
    """The place and the error of each distribution that cannot be read: then libraries that look for plugins fail."""
    for distribution in distributions():
        try:
            _ = distribution.entry_points
        except Exception as error:
            yield f"{_place(distribution)}: {cause(error)}"


def _place(distribution: Distribution) -> str:
    return os.path.abspath(getattr(distribution, "_path", None) or str(distribution.locate_file("")))
