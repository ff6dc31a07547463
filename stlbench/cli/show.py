"""`stlbench show`: one thing in full."""

from __future__ import annotations

import typer

from stlbench.cli.show_cell import cell
from stlbench.cli.show_method import method
from stlbench.cli.show_task import task

app = typer.Typer(rich_markup_mode=None)


@app.callback()
def show() -> None:
    """Show one thing in full, such as a task.

    \b
    Example:
      stlbench show task hold-disc
    """


for command in (task, cell, method):
    app.command(command.__name__)(command)
