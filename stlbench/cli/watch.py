"""`stlbench watch`: what runs in a folder of results, from another terminal."""

from __future__ import annotations

import time
from contextlib import nullcontext
from functools import lru_cache
from pathlib import Path
from typing import Annotated

import typer

from stlbench.errors import UsageError
from stlbench.records import lock
from stlbench.records.ledger import FILE, Ledger
from stlbench.study.live_cells import draws, running
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

    if not (folder / FILE).is_file():
        raise UsageError(f"there is no ledger in {folder}/; name a folder that `stlbench run` writes")
    console, before = Console(highlight=False, soft_wrap=True), list[str]()
    with Live(console=console, auto_refresh=False, transient=False) if console.is_terminal else nullcontext() as live:
        while True:
            writer = lock.writer(folder)
            cells = running(folder) if writer else None
            stamp = (writer, *(path.stat().st_mtime for path in folder.glob(f"{FILE}*")))
            first, *rest = _tally(folder / FILE, stamp).lines(cells, time.time(), drawn=draws(console))
            lines = [first, *(f"  {line}" for line in rest)]
            if live is not None:
                live.update(Text("\n".join(lines)), refresh=True)
            else:
                for line in lines:
                    if line not in before:
                        typer.echo(line)
            before = lines
            if once or writer is None:
                return
            time.sleep(every)


@lru_cache(maxsize=1)
def _tally(path: Path, stamp: tuple[object, ...]) -> Tally:
    """Reads the ledger anew when its `stamp` has changed."""
    with Ledger(path, create=False) as ledger:
        tally = Tally(ledger.missing())
        for result in ledger.results():
            tally.add(result)
    return tally
