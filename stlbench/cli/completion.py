"""Names of plugins, completed by the shell."""

from __future__ import annotations

import warnings
from collections.abc import Callable


def names(kind: str) -> Callable[[str], list[str]]:
    """What completes the name of a plugin of one of `plugins.KINDS`, also the last one of a comma list."""

    def completed(incomplete: str) -> list[str]:
        from stlbench.registry import plugins

        before, comma, last = incomplete.rpartition(",")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a broken plugin, while someone types
            return [before + comma + name for name in plugins.available(kind) if name.startswith(last)]

    return completed
