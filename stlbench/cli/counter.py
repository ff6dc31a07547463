"""One subject of a search after the other: a bar on stderr where that is a terminal, and of several a line for each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeVar

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

from stlbench.errors import one_line

if TYPE_CHECKING:
    from stlbench.search.subject import Subject

Found = TypeVar("Found")


def one_by_one(
    subjects: Sequence[Subject],
    episodes: int,
    work: Callable[[Subject, Callable[[int, float], None]], Found],
    line: Callable[[Found], str],
    show: Callable[[list[Found]], None],
) -> None:
    """Work on each of the subjects, and show what was found; where someone interrupts, so far, and exit with code 130.

    Of several, one that cannot be searched is left out: a line says why, and the exit code is 2.

    Args:
        subjects: what is searched.
        episodes: how many each takes at most.
        work: on one subject; is given what to call with the number of its episodes so far, and a second number.
        line: what was found, in short.
        show: all that was found, at least one.

    Raises:
        UsageError: what ends all; or the only subject cannot be searched.
    """
    from stlbench.search.subject import Unsearchable

    console = Console(stderr=True, highlight=False, soft_wrap=True)
    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    found, interrupted, refused = list[Found](), False, False
    with Progress(*columns, console=console, disable=not console.is_terminal, transient=True) as bar:
        counted = bar.add_task("", total=episodes)
        try:
            for place, subject in enumerate(subjects, 1):
                bar.reset(counted, total=episodes, description=escape(subject.name))
                try:
                    found.append(work(subject, lambda count, _: bar.update(counted, completed=count)))
                    told = line(found[-1])
                except Unsearchable as error:
                    if len(subjects) == 1:
                        raise
                    refused, told = True, f"error: {one_line(error)}"
                if len(subjects) > 1:
                    console.print(Text(f"[{place}/{len(subjects)}] {told}"))
        except KeyboardInterrupt:
            interrupted = True
    if found:
        show(found)
    if interrupted:
        typer.echo(f"interrupted: {len(found)} of {len(subjects)} were searched", err=True)
        raise typer.Exit(130)
    if refused:
        raise typer.Exit(2)
