"""`stlbench watch`: what runs in a folder of results, from another terminal."""

from __future__ import annotations

import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stlbench.errors import UsageError

if TYPE_CHECKING:
    from stlbench.result import CellId, Result
    from stlbench.study.running import Running


def watch(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A folder in which `stlbench run` writes.")],
    every: Annotated[float, typer.Option(metavar="SECONDS", min=0.1, help="How often to look.")] = 2.0,
    once: Annotated[bool, typer.Option("--once", help="Look once.")] = False,
) -> None:
    """Show what runs in a folder of results, until nobody writes in it any more.

    Says how many cells are done and how many failed, how long the rest may take, and of each cell that runs its step
    and the score of its last checkpoint, from a few starts. In a pipe it prints lines, and only when something changed.

    \b
    Examples:
      stlbench watch results
      stlbench watch results --once
    """
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    from stlbench.study import lock

    looker, console = _Looker(folder), Console(highlight=False, soft_wrap=True)
    with Live(console=console, auto_refresh=False, transient=False) if console.is_terminal else _Lines() as shown:
        while True:
            writer = lock.writer(folder)
            shown.update(Text("\n".join(looker.lines(writer))), refresh=True)
            if once or writer is None:
                return
            time.sleep(every)


class _Lines:
    """Where there is no terminal: prints what differs from before."""

    def __init__(self) -> None:
        self.before = list[str]()

    def __enter__(self) -> _Lines:
        return self

    def __exit__(self, *_: object) -> None: ...

    def update(self, text: object, *, refresh: bool) -> None:
        lines = str(text).splitlines()
        for line in lines:
            if line not in self.before:
                typer.echo(line)
        self.before = lines


class _Looker:
    """Reads a folder; its ledger only when that has changed."""

    def __init__(self, folder: Path) -> None:
        from stlbench.study.ledger import FILE

        self.folder, self.path = folder, folder / FILE
        if not self.path.is_file():
            raise UsageError(f"there is no ledger in {folder}/; name a folder that `stlbench run` writes")
        self.stamp: tuple[float, ...] = ()
        self.results: list[Result] = []
        self.missing: list[CellId] = []

    def lines(self, writer: str | None) -> list[str]:
        """What is to be said now."""
        from stlbench.cli.live import MOST, line_of
        from stlbench.study.running import running

        self._read()
        cells, now = running(self.folder) if writer else [], time.time()
        more = [f"  and {len(cells) - MOST} more"] if len(cells) > MOST else []
        return [self._counts(cells, now, writer), *(f"  {line_of(one, now)}" for one in cells[:MOST]), *more]

    def _read(self) -> None:
        from stlbench.study import stored

        stamp = tuple(path.stat().st_mtime for path in self.folder.glob(f"{self.path.name}*"))
        if stamp != self.stamp:
            self.results, self.missing = list(stored.read(self.folder)), stored.missing(self.folder)
            self.stamp = stamp

    def _counts(self, cells: list[Running], now: float, writer: str | None) -> str:
        from stlbench.cli.live import begun_of, remaining
        from stlbench.study.outlook import Took

        counts = Counter[str](result.status for result in self.results)
        begun = begun_of(cells, now)
        waiting = [cell for cell in self.missing if all(cell != one.cell for one in begun)]
        took = [Took(each.id, each.measurement.wall_seconds) for each in self.results if each.measurement]
        left = remaining(waiting, begun, took, max(1, len(begun))) if writer else ""
        total = len(self.results) + len(self.missing)
        said = [f"{len(self.results)} of {total} cells", *(f"{count} {status}" for status, count in counts.items())]
        said += [f"{len(cells)} running"] if writer else ["nobody writes here"]
        return ", ".join([*said, *([left] if left else [])])
