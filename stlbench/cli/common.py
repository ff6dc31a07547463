"""What the commands share: errors as one line, JSON alone on stdout, and the console for tables."""

from __future__ import annotations

import errno
import json
import math
import os
import re
import sys
import warnings
from collections.abc import Mapping, Sequence
from io import TextIOWrapper
from typing import TYPE_CHECKING, Annotated, Any, TextIO

import typer
from typer.core import TyperGroup

from stlbench.contract_parts.texts import one_line, printable
from stlbench.errors import UsageError, is_disk_full

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["DISK_FULL", "Commands", "Json", "console", "print_json", "refuse", "warn"]

Json = Annotated[bool, typer.Option("--json", help="Print JSON, and nothing else, on stdout.")]

DISK_FULL = 74
"""The exit code where results cannot be written since the disk is full; that of an input/output error in sysexits.h."""


_COLOUR = re.compile("\x1b\\[[0-9;]*m")

_OF_PATHS = (errno.ENAMETOOLONG, errno.EACCES, errno.EPERM)
"""Errors of a path that a user has named, which even a look at whether it is there raises."""


class Commands(TyperGroup):
    """All commands. What a user did wrong is one line on stderr and exit code 2; anything else is a bug and shows."""

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        windows_expand_args: bool = True,
        **extra: Any,
    ) -> Any:
        """Run the command line, and exit unless `standalone_mode` is off."""
        if isinstance(sys.stdout, TextIOWrapper):
            sys.stdout.reconfigure(errors="backslashreplace")  # names of files need be no text; stderr is so already
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning
            try:
                code = super().main(args, prog_name, complete_var, False, windows_expand_args, **extra)
            except UsageError as error:
                code = refuse(str(error), DISK_FULL if is_disk_full(error) else 2)
            except OSError as error:
                if not (is_disk_full(error) or error.errno in _OF_PATHS):
                    raise
                code = refuse(str(error), DISK_FULL if is_disk_full(error) else 2)
            except typer.Abort:
                typer.echo(err=True)  # ends the line of a question that nobody answered
                code = refuse("the question was not answered with yes; nothing was changed", 1)
            except typer.TyperException as error:
                code = refuse(error.format_message().replace(": Value error, ", ": ", 1) + _where_to_look(error))
        if standalone_mode:
            sys.exit(code)
        return code

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the commands under the names of their groups."""
        groups = dict[str, list[tuple[str, str]]]()
        shown = [(name, command) for name, command in self.commands.items() if not command.hidden]
        room = formatter.width - 6 - max(len(name) for name, _ in shown)
        for name, command in shown:
            group = getattr(command, "rich_help_panel", None)
            groups.setdefault(group if isinstance(group, str) else "Commands", []).append(
                (name, command.get_short_help_str(room))
            )
        for group, rows in groups.items():
            with formatter.section(group):
                formatter.write_dl(rows, col_max=20)

    def invoke(self, ctx: Any) -> Any:
        """Run the chosen command, and end quietly where the reader of stdout has gone, as `head` does."""
        try:
            try:
                return super().invoke(ctx)
            finally:
                sys.stdout.flush()
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is left in the buffer goes nowhere
            raise typer.Exit(128 + 13) from None  # what a shell says of a command that SIGPIPE stopped


def refuse(message: str, code: int = 2) -> int:
    """Print what is wrong as one line on stderr; return the exit code."""
    typer.echo(f"error: {printable(message)}", err=True)
    return code


def _where_to_look(error: typer.TyperException) -> str:
    context = getattr(error, "ctx", None)
    return "" if context is None else f" (see '{context.command_path} --help')"


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    warn(_COLOUR.sub("", str(message)))  # Gymnasium writes its warnings in yellow


def warn(message: str) -> None:
    """One line on stderr."""
    typer.echo(f"warning: {one_line(message)}", err=True)


def print_json(value: Any) -> None:
    """Print a value as JSON. JSON has no infinity, so that is null, as is NaN."""
    typer.echo(json.dumps(_finite(value), indent=2, ensure_ascii=False))


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _finite(part) for key, part in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_finite(part) for part in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if isinstance(value, str | int | float | None) else str(value)


def console() -> Console:
    """Where tables are printed: as wide as the terminal; elsewhere `COLUMNS` wide, or 120 without it."""
    from rich.console import Console

    class Out(Console):
        def on_broken_pipe(self) -> None:
            raise BrokenPipeError  # rich itself would exit with code 1, which has another meaning here

    return Out(width=None if sys.stdout.isatty() else _columns(), highlight=False)


def _columns() -> int:
    """The width that the environment names, for a file or a pipe."""
    said = os.environ.get("COLUMNS", "")
    return int(said) if re.fullmatch("[1-9][0-9]{0,4}", said) else 120
