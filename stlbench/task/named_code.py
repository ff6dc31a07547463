"""The code that a folder of a task has, or has imported: where it is a stranger's, none of it may run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from stlbench.errors import UsageError
from stlbench.registry.fingerprint import TASK_FILE
from stlbench.task.file import Environment, TaskFile
from stlbench.task.reading import read_task_file


def code_of(home: Path) -> tuple[str, ...]:
    """The code that the folder of a task runs, in a few words each; none where it is data alone.

    Ask it before the folder is known (`folders.know`), where the user did not name that folder as a task. Raises
    `UsageError` as `file_of`.
    """
    environment = file_of(home).environment
    files = sorted(path.name for path in home.iterdir() if path.suffix.lower() == ".py")
    return (*files, *(imported(environment) if environment else ()))


def file_of(home: Path) -> TaskFile:
    """The task file of a folder, by itself. Raises `UsageError` where there is none, or it has errors."""
    path = home / TASK_FILE
    try:
        return read_task_file(path.read_text(encoding="utf-8"), home.name)
    except (OSError, UnicodeError) as error:
        raise UsageError(f"cannot read {path}: {error}") from error


def imported(environment: Environment) -> Iterator[str]:
    """The texts that have a module imported: an id that says where it is registered, or a text among the arguments.

    An id that an installed package has registered is none. Environments may import what a text names, as a class of
    vehicles, or make another environment of it.
    """
    if environment.id is not None and (environment.api != "gymnasium" or ":" in environment.id):
        yield f"the module of {environment.id}"
    for name in ("kwargs", "drawn"):
        if not _is_plain(getattr(environment, name)):
            yield f"what environment.{name} may name in a text"


def _is_plain(value: Any) -> bool:
    """Whether it consists of numbers, flags and nothing else."""
    if isinstance(value, Mapping):
        return all(map(_is_plain, value.values()))
    if isinstance(value, list | tuple):
        return all(map(_is_plain, value))
    return value is None or isinstance(value, int | float)
