"""The options that commands share: lists of names, jobs, executors, task folders, what to run again, how to show."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

if TYPE_CHECKING:
    from stlbench.registry.choices import Choice

Jobs = Annotated[
    int | None, typer.Option(min=1, metavar="N", help="Cells at a time.", show_default="2, or 1 on a single core")
]
Explain = Annotated[bool, typer.Option("--explain", help="Print the notes that say how to read the tables.")]
Fitting = Annotated[
    Literal["column", "page"], typer.Option("--width", help="What figures and LaTeX fit: 3.5 or 7.16 inches.")
]
Executor = Annotated[str, typer.Option(metavar="NAME", help="Where cells run.")]
Retry = Annotated[
    str | None,
    typer.Option(metavar="LIST", help="Run cells again that ended so: failed, or some of raised, timeout, killed."),
]


def _known(paths: list[Path] | None) -> list[Path] | None:
    from stlbench.registry.folders import know

    for path in paths or ():
        know(path)
    return paths


TaskFolders = Annotated[
    list[Path] | None,
    typer.Option(
        "--task-folder",
        metavar="PATH",
        callback=_known,
        help="Folder of a task that the results are of. Its code is run. May be given several times.",
    ),
]
"""Results never say where code is: only the user does. The option's callback makes the folders known."""


def names(text: str | None) -> tuple[Choice, ...] | None:
    """The choices of a comma list; None where the option is not given."""
    from stlbench.registry.choices import parse_choices

    return None if text is None else parse_choices(text)


def tasks_of(text: str | None) -> tuple[Choice, ...] | None:
    """The same for tasks, each a name or the path of a folder."""
    from stlbench.registry.folders import parse_tasks

    return None if text is None else parse_tasks(text)
