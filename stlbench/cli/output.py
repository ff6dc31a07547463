"""The output of commands: facts as JSON alone on stdout, or else lines, and tables on the console."""

from __future__ import annotations

import ctypes
import json
import math
import os
import re
import sys
from collections.abc import Container, Iterable, Mapping, Sequence
from contextlib import ExitStack, redirect_stdout, suppress
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stlbench.errors import UNSAFE

if TYPE_CHECKING:  # `stlbench --help` needs none of it
    from rich.console import Console

    from stlbench.report.tables.table import Table

_APART = ExitStack()  # while it is open, all output goes to stderr


def _alone(context: typer.Context, wanted: bool) -> bool:
    """Keep stdout for `print_json`; output of plugins and of their programs goes to stderr."""
    if wanted:
        sys.stdout.flush()
        with suppress(OSError):  # a test's stream has no descriptor
            if sys.stdout.fileno() == 1:
                _APART.callback(_move_back, os.dup(1))
                os.dup2(2, 1)
        _APART.enter_context(redirect_stdout(sys.stderr))
        context.call_on_close(_APART.close)
    return wanted


Json = Annotated[bool, typer.Option("--json", help="Print JSON, and nothing else, on stdout.", callback=_alone)]


def _move_back(kept: int) -> None:
    with suppress(Exception):
        ctypes.CDLL(None).fflush(None)  # what compiled code has printed and keeps
    os.dup2(kept, 1)
    os.close(kept)


def print_json(value: Any) -> None:
    """Print a value as JSON, once in a command. JSON has no infinity, so that is null, as is NaN.

    A character that no terminal takes becomes an escape of JSON, which means the same.
    """
    _APART.close()
    text = json.dumps(_finite(value), indent=2, ensure_ascii=False)
    typer.echo(UNSAFE.sub(lambda match: json.dumps(match[0])[1:-1], text))


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _finite(part) for key, part in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_finite(part) for part in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if isinstance(value, str | int | float | None) else str(value)


def show(as_json: bool, facts: Any, text: Iterable[str | Table]) -> None:
    """Print the result of a command once: its facts as JSON, or else its text, lines and tables in their order.

    Commands yield the text from a generator, which does not run for JSON.
    """
    if as_json:
        print_json(facts)
    else:
        say(text)


def say(text: Iterable[str | Table], *, explain: bool = True, explained: Container[Table] = ()) -> None:
    """Print lines and tables in their order, with the notes of all tables to `explain`, else of those `explained`."""
    from stlbench.report.tables.table import to_screen

    out = console()
    for part in text:
        if isinstance(part, str):
            typer.echo(part)
        else:
            to_screen(part, out, explain=explain or part in explained)


def table(title: str, rows: Sequence[Mapping[str, Any]], *notes: str) -> Table:
    """A table of facts: rows name their columns. Numbers are on the right, as in the first row that has the column."""
    from stlbench.report.tables.table import Column, Table

    first = {name: value for row in reversed(rows) for name, value in row.items()}
    names = list(dict.fromkeys(name for row in rows for name in row))
    columns = tuple(Column(name, right=isinstance(first[name], int | float)) for name in names)
    return Table(title, columns, tuple(tuple(row.get(name) for name in names) for row in rows), notes)


def console() -> Console:
    """For tables: as wide as the terminal; elsewhere `COLUMNS` wide, or 120 without it."""
    from rich.console import Console

    class Out(Console):
        def on_broken_pipe(self) -> None:
            raise BrokenPipeError  # rich itself would exit with code 1, which has another meaning here

    columns = os.environ.get("COLUMNS", "")
    width = int(columns) if re.fullmatch("[1-9][0-9]{0,4}", columns) else 120
    return Out(width=None if sys.stdout.isatty() else width, highlight=False)
