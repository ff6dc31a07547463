"""Agents with compiled code, and notes of what is compiled. Imports no Numba, which takes a while."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from stlbench.contract import Agent
from stlbench.contract.compiled import folder


def is_ready(part: str) -> bool:
    """Whether this machine has compiled a part of the code of this package, in its present state."""
    kept = folder(__package__)
    return kept is not None and (kept / part).exists()


def note_ready(part: str) -> None:
    """Note that it has; if nothing can be written, each process compiles again."""
    if kept := folder(__package__):
        with suppress(OSError):
            (kept / part).touch()


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
