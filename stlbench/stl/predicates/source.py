"""Python source that is made here, as functions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any


def functions(source: Sequence[str], namespace: Mapping[str, Any]) -> dict[str, Callable[..., Any]]:
    """The functions that the lines define, by name. They know the names of `namespace` and no others."""
    scope: dict[str, Any] = {**namespace, "__builtins__": {}}
    # Safe: every character of the source is ours. Signals are column numbers, constants reprs of floats and numbers of
    # steps, operators and functions texts of our tables; `test_compiler` and `test_monitor_source` hold it to that.
    exec(compile("\n".join(source), "<stlbench.stl>", "exec"), scope)  # noqa: S102
    return {name: value for name, value in scope.items() if name not in namespace and callable(value)}


def indented(lines: Iterable[str]) -> list[str]:
    """The lines as a block under another."""
    return [f" {line}" for line in lines]


def block(head: str, lines: Sequence[str]) -> list[str]:
    """`head:` and the lines under it; nothing if there are none."""
    return [f"{head}:", *indented(lines)] if lines else []
