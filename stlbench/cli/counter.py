"""How far a search is: a bar on stderr where that is a terminal, and of several subjects a line for each."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

__all__ = ["Counter"]


class Counter:
    """Counts the episodes of each subject in turn; as a context manager it takes the bar away at the end."""

    def __init__(self, subjects: int, episodes: int) -> None:
        """Args: how many subjects, and how many episodes each takes at most."""
        self._subjects, self._episodes, self._done = subjects, episodes, 0
        self._console = Console(stderr=True, highlight=False, soft_wrap=True)
        columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
        self._bar = Progress(*columns, console=self._console, disable=not self._console.is_terminal, transient=True)
        self._task = self._bar.add_task("", total=episodes)

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._bar.stop()

    def begin(self, name: str) -> None:
        """Say which subject comes."""
        self._bar.reset(self._task, total=self._episodes, description=Text(name).plain.replace("[", r"\["))

    def count(self, episodes: int) -> None:
        """Say how many of its episodes were simulated."""
        self._bar.update(self._task, completed=episodes)

    def ended(self, line: str) -> None:
        """Say what came of a subject, where it is one of several."""
        self._done += 1
        if self._subjects > 1:
            self._console.print(Text(f"[{self._done}/{self._subjects}] {line}"))
