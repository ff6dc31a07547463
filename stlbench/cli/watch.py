"""`stlbench watch`: what runs in a folder of results, from another terminal."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from stlbench.study.progress import Tally


def watch(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A folder in which `stlbench run` writes.")],
    every: Annotated[float, typer.Option(metavar="SECONDS", min=0.1, help="How often to look.")] = 2.0,
    once: Annotated[bool, typer.Option("--once", help="Look once.")] = False,
) -> None:
    """Show what runs in a folder of results, until nobody writes in it any more.

    Says how many cells are done and how many failed, how long the rest may take, and of each cell that runs its step,
    the score of its last checkpoint, from a few starts, and the robustness of its checkpoints so far. In a pipe it
    prints lines, and only when something changed.

    \b
    Examples:
      stlbench watch results
      stlbench watch results --once
    """
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    from stlbench.records import lock
    from stlbench.study.live_cells import draws, running

    ledger = _Ledger(folder)
    console = Console(highlight=False, soft_wrap=True)
    with Live(console=console, auto_refresh=False, transient=False) if console.is_terminal else _Lines() as shown:
        while True:
            writer = lock.writer(folder)
            cells = running(folder) if writer else None
            first, *lines = ledger.tally(writer).lines(cells, time.time(), drawn=draws(console))
            shown.update(Text("\n".join([first, *(f"  {line}" for line in lines)])), refresh=True)
            if once or writer is None:
                return
            time.sleep(every)


class _Ledger:
    """Reads the ledger of a folder, only when that has changed. Raises `UsageError` where there is none."""

    def __init__(self, folder: Path) -> None:
        from stlbench.errors import UsageError
        from stlbench.records.ledger import FILE

        self.path = folder / FILE
        if not self.path.is_file():
            raise UsageError(f"there is no ledger in {folder}/; name a folder that `stlbench run` writes")
        self._stamp: tuple[object, ...] = ()
        self._tally: Tally | None = None

    def tally(self, writer: str | None) -> Tally:
        from stlbench.records.ledger import Ledger
        from stlbench.study.progress import Tally

        stamp = (writer, *(path.stat().st_mtime for path in self.path.parent.glob(f"{self.path.name}*")))
        if self._tally is None or stamp != self._stamp:
            with Ledger(self.path, create=False) as ledger:
                self._tally = Tally(ledger.missing())
                for result in ledger.results():
                    self._tally.add(result)
            self._stamp = stamp
        return self._tally


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
