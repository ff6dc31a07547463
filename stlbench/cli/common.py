"""Common to all commands: they are imported when they are called, and their errors are one line."""

import errno
import os
import re
import sys
import traceback
import warnings
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from io import TextIOWrapper
from typing import Any, ClassVar, TextIO

import typer
from typer.core import TyperGroup

from stlbench.errors import NO_SPACE, DiskFull, UsageError, cause, in_words, one_line, printable
from stlbench.registry import exits
from stlbench.registry.exits import exits_raise

CANNOT_TELL = 3  # the exit code of `verify` and `report` if a policy was not scored again, as that of `compare`
DISK_FULL = 74  # the exit code if the disk is full: an input/output error in sysexits.h
_COLOUR = re.compile("\x1b\\[[0-9;]*m")
_OF_PATHS = (errno.ENAMETOOLONG, errno.EACCES, errno.EPERM)
"""Errors of a user's path, raised even by a test whether it exists."""


class Commands(TyperGroup):
    """All commands. An error of the user is one line on stderr and exit code 2; a bug has its traceback."""

    groups: ClassVar[Mapping[str, Mapping[str, tuple[str, str]]]]
    """Group -> command -> its function or its Typer, as module.name in this package, and what it does."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        places = {name: place for group in self.groups.values() for name, (place, _) in group.items()}
        self.commands: Any = _Loaded(places)

    def list_commands(self, ctx: Any) -> list[str]:
        return list(self.commands)

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        windows_expand_args: bool = True,
        **extra: Any,
    ) -> Any:
        _open_standard_streams()
        if isinstance(sys.stdout, TextIOWrapper):
            sys.stdout.reconfigure(errors="backslashreplace")  # names of files need be no text; stderr is so already
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning
            try:
                code = super().main(args, prog_name, complete_var, False, windows_expand_args, **extra)
            except UsageError as error:
                code = refuse(str(error), DISK_FULL if isinstance(error, DiskFull) else 2)
            except OSError as error:
                if error.errno not in (*NO_SPACE, *_OF_PATHS):
                    raise
                code = refuse(str(UsageError(str(error))), DISK_FULL if error.errno in NO_SPACE else 2)
            except typer.Abort:
                typer.echo(err=True)  # ends the line of a question that nobody answered
                code = refuse("the question was not answered with yes; nothing was changed", 1)
            except typer.TyperException as error:
                begin, colon, rule = error.format_message().partition(": ")  # "Invalid value for '--seed': ..."
                context = getattr(error, "ctx", None)
                where = "" if context is None else f" (see '{context.command_path} --help')"
                code = refuse(f"{begin}{colon}{in_words(rule)}{where}")
            except Exception as error:
                code = refuse(_of_others(error))
        if standalone_mode:
            sys.exit(code)
        return code

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        for group, commands in self.groups.items():
            with formatter.section(group):
                formatter.write_dl([(name, text) for name, (_, text) in commands.items()], col_max=20)

    def invoke(self, ctx: Any) -> Any:
        """Run the command, and end quietly if the reader of stdout has gone, as `head` does.

        A plugin that ends the process is an error.
        """
        try:
            try:
                with exits_raise():
                    return super().invoke(ctx)
            except SystemExit as error:
                place = traceback.extract_tb(error.__traceback__)
                last = next(frame for frame in reversed(place) if frame.filename != exits.__file__)
                raise UsageError(f"{last.filename}, line {last.lineno}, ended the command: {cause(error)}") from error
            finally:
                sys.stdout.flush()
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is left in the buffer goes nowhere
            raise typer.Exit(128 + 13) from None  # what a shell says of a command that SIGPIPE stopped


class _Loaded(Mapping[str, Any]):
    """The commands by name. The module of a command is imported when the command is asked for."""

    def __init__(self, places: Mapping[str, str]) -> None:
        self._places = places

    def __getitem__(self, name: str) -> Any:
        module, _, attribute = self._places[name].partition(".")
        command = getattr(import_module(f"stlbench.cli.{module}"), attribute)
        if isinstance(command, typer.Typer):
            return typer.main.get_group(command)
        alone = typer.Typer(add_completion=False, rich_markup_mode=None)
        alone.command(name)(command)
        return typer.main.get_command(alone)

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


def _open_standard_streams() -> None:
    """Open streams that the caller has closed (`>&-`): else the next opened file would be taken for stdout."""
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the least number that is free
    sys.stdout = sys.stdout or os.fdopen(1, "w", closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, "w", closefd=False)


def _of_others(error: Exception) -> str:
    """The message for an error in code or files of others. Raises the error where it is in none: it is a bug."""
    if (problem := _damaged(error)) is not None:
        return f"an installed distribution cannot be read; install it again, or remove it: {problem}"
    from stlbench.registry.plugins import blamed

    if (line := blamed(error)) is None:
        raise error
    return line


def _damaged(error: Exception) -> str | None:
    """The damaged distribution, if a library failed on its metadata; None for any other error."""
    names = (frame.f_globals.get("__name__", "") for frame, _ in traceback.walk_tb(error.__traceback__))
    if "importlib.metadata" not in names:
        return None
    from stlbench.registry.plugins import damaged

    return next(damaged(), None)


def refuse(message: str, code: int = 2) -> int:
    typer.echo(f"error: {printable(message)}", err=True)
    return code


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
    typer.echo(f"warning: {one_line(message)}", err=True)
