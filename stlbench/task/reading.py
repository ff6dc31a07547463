"""From the text of a `task.yaml` to a task file, or to all that is wrong with it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from pydantic import ValidationError

from stlbench.errors import UsageError, did_you_mean, in_words
from stlbench.task.checks import check_entries
from stlbench.task.entry import Timing
from stlbench.task.file import TaskFile
from stlbench.task.parts import Parts, as_parts, fields_at, right_parts
from stlbench.task.yaml_text import load_yaml


@dataclass(frozen=True)
class Reading:
    """What was read: a file, or errors and the entries that are right by themselves."""

    file: TaskFile | None
    parts: Parts
    errors: tuple[str, ...]
    """A line per error, with its place; none where there is a file."""


@lru_cache(maxsize=64)
def read(text: str, name: str) -> Reading:
    """A task file's text, with every error. Raises `UsageError` where it is no YAML.

    Cached, since a command asks for its tasks several times, and YAML is slow to read.
    """
    content = load_yaml(text, f"task {name}: task.yaml")
    timing = _timing(content)
    try:
        file = TaskFile.model_validate(content, context=timing)
    except ValidationError as error:
        parts = right_parts(TaskFile, content, timing)
        return Reading(None, parts, (*_lines(error), *check_entries(parts, timing)))
    parts = as_parts(file)
    errors = tuple(check_entries(parts, timing))
    return Reading(None if errors else file, parts, errors)


def read_task_file(text: str, name: str) -> TaskFile:
    """A task file's text, checked by itself, without its system. Raises `UsageError` that lists every error."""
    reading = read(text, name)
    if reading.file is None:
        raise errors_of(name, reading.errors)
    return reading.file


def errors_of(name: str, errors: Sequence[str]) -> UsageError:
    """All errors of a task's file as one message."""
    lines = "\n".join(errors).replace("\n", "\n  ")
    return UsageError(f"task {name}: task.yaml has errors:\n  {lines}")


def _timing(content: Any) -> Timing:
    """How the file's intervals are read, from what its `time`, `sampling_time` and `steps` say."""
    if not isinstance(content, Mapping):
        return Timing(known=False)
    some = {key: content[key] for key in ("time", "sampling_time", "steps") if key in content}
    parts = right_parts(TaskFile, some, Timing())
    if parts.get("time") == "steps" and "steps" in parts:
        return Timing(None, parts["steps"])
    if parts.get("time") == "seconds" and {"sampling_time", "steps"} <= parts.keys():
        return Timing(parts["sampling_time"], parts["steps"])
    return Timing(1e-6, known=False)  # so small that every end of an interval that anyone writes is whole


_TYPE = re.compile(r"(dict|tuple)\[")
"""Of a place that may have values of several types, Pydantic names the type too."""


def _lines(error: ValidationError) -> Iterator[str]:
    for item in error.errors():
        parts = [str(part) for part in item["loc"]]
        message = in_words(item["msg"])
        if item["type"] == "extra_forbidden":
            message = f"there is no such key{did_you_mean(parts[-1], fields_at(TaskFile, parts[:-1]))}"
        place = ".".join(part for part in parts if not _TYPE.match(part))
        yield f"{place}: {message}" if place else message
