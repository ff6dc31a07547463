"""`stlbench watch`: what runs in a folder of results, from another terminal."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from stlbench.cli.looker import Looker


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
    from stlbench.cli.looker import Looker

    _show(Looker(folder), every, once)


def _show(looker: Looker, every: float, once: bool) -> None:
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    from stlbench.study.live_cells import draws

    console = Console(highlight=False, soft_wrap=True)
    with Live(console=console, auto_refresh=False, transient=False) if console.is_terminal else _Lines() as shown:
        while True:
            view = looker.look()
            shown.update(Text("\n".join(view.lines(drawn=draws(console)))), refresh=True)
            if once or view.writer is None:
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
