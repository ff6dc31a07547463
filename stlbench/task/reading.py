"""Makes the texts of a `task.yaml` and a `by_hand.yaml` a task file, or names all that is wrong with it; and names
the code that the folder of a task would run.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin

import yaml
from pydantic import BaseModel, TypeAdapter, ValidationError

from stlbench.errors import UsageError, cause, did_you_mean, in_words, one_line, printable
from stlbench.registry.fingerprint import TASK_FILE
from stlbench.task.checks import check_entries
from stlbench.task.entry import Parts, Timing
from stlbench.task.file import BY_HAND, Environment, TaskFile

_MERGE = "tag:yaml.org,2002:merge"

MOST = 200_000
"""Values that a file may have, each alias counted as what it stands for."""


_NUMBERS = {
    "tag:yaml.org,2002:int": re.compile(r"[-+]?[0-9][0-9_]*$"),
    "tag:yaml.org,2002:float": re.compile(
        r"[-+]?(?:(?:[0-9][0-9_]*\.?[0-9_]*|\.[0-9]+)[eE][-+]?[0-9]+|[0-9][0-9_]*\.[0-9_]*|\.[0-9][0-9_]*)$"
        r"|[-+]?\.(?:inf|Inf|INF)$|\.(?:nan|NaN|NAN)$"
    ),
}
"""Numbers as YAML 1.2 and other programs have them. PyYAML reads 010 as 8, 1:30 as 90 and 1e-3 as a text."""


class _Loader(yaml.SafeLoader):
    pass


class _Dumper(yaml.SafeDumper):
    """Quotes each text that `_Loader` or PyYAML's own loader would read as a number."""


_Loader.yaml_implicit_resolvers = {
    first: [(tag, words) for tag, words in known if tag not in _NUMBERS]
    for first, known in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
for _tag, _written in _NUMBERS.items():
    for _kind in (_Loader, _Dumper):
        _kind.add_implicit_resolver(_tag, _written, list("-+.0123456789"))
_Loader.add_constructor("tag:yaml.org,2002:int", lambda loader, node: int(node.value))


def dump_yaml(content: Any, **layout: Any) -> str:
    """A text that `load_yaml` reads, with the keys in their order."""
    return str(yaml.dump(content, Dumper=_Dumper, sort_keys=False, **layout))


def load_yaml(text: str, place: str) -> Any:
    """The content of a text, which comes from `place`. It has the escapes of characters that no terminal takes.

    Raises:
        UsageError: it is no YAML, a mapping has a key twice, or a value is none of its type (2001-99-99). Or a text has
            half a character ("\\ud800"), it nests too deep, or a few aliases stand for more than any file would have.
    """
    try:
        content = _loaded(text)
        size = _size(content, {})
    except _TwiceError as twice:
        raise UsageError(f"{place} has {twice}") from None
    except yaml.YAMLError as error:
        raise UsageError(f"{place} is no YAML: {error}") from error
    except UnicodeEncodeError as error:
        half = one_line(error.object[error.start])
        raise UsageError(f"{place} has a text with {half}, which is a half of a character") from error
    except RecursionError:
        raise UsageError(f"{place} nests too deep") from None
    except Exception as error:  # a date raises ValueError, and a word that should be true or false raises KeyError
        raise UsageError(f"{place} is no YAML: a value is none of its type ({cause(error)})") from error
    if size > MOST:
        raise UsageError(f"{place} has more than {MOST} values, or an alias inside of what it stands for")
    return content


class _TwiceError(Exception):
    """The key that is there twice, and its lines."""


def _loaded(text: str) -> Any:
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        _check(node, set())
        return None if node is None else loader.construct_document(node)
    finally:
        loader.dispose()


def _check(node: yaml.Node | None, seen: set[int]) -> None:
    """Make texts safe. Raises `_TwiceError`: YAML's own reader would take the last value of a key, and say nothing."""
    if isinstance(node, yaml.ScalarNode):
        node.value.encode()  # no character is a half of a surrogate pair, which an escape can name
        node.value = printable(node.value, len(node.value))
    if not isinstance(node, yaml.CollectionNode) or id(node) in seen:
        return
    seen.add(id(node))
    lines = dict[tuple[str, str], int]()
    for part in node.value:
        key, value = part if isinstance(node, yaml.MappingNode) else (None, part)
        _check(key, seen)
        if isinstance(key, yaml.ScalarNode) and key.tag != _MERGE:
            name, line = (key.tag, key.value), key.start_mark.line + 1
            if name in lines:
                raise _TwiceError(f"the key '{one_line(key.value)}' in line {lines[name]} and again in line {line}")
            lines[name] = line
        _check(value, seen)


def _size(value: Any, known: dict[int, int]) -> int:
    """The number of values in it. A value within itself has too many."""
    if not isinstance(value, Mapping | list | set | tuple):
        return 1
    if id(value) not in known:
        known[id(value)] = MOST + 1  # an alias that is met again before its own sum is known lies within itself
        parts = [*value, *value.values()] if isinstance(value, Mapping) else value
        known[id(value)] = 1 + sum(_size(part, known) for part in parts)
    return known[id(value)]


@dataclass(frozen=True)
class Reading:
    """The result of reading: a file, or errors and the entries that are right by themselves."""

    file: TaskFile | None
    parts: Parts
    errors: tuple[str, ...]
    """A line per error, with its place; none if there is a file."""


@lru_cache(maxsize=64)
def read(text: str, name: str, by_hand: str | None = None) -> Reading:
    """A task file's text, with every error, and that of the `by_hand.yaml` beside it, if there is one.

    Raises `UsageError` if one of them is no YAML, or `by_hand.yaml` has a key that it may not have.

    Cached, since a command asks for its tasks several times, and YAML is slow to read.
    """
    content = load_yaml(text, f"task {name}: task.yaml")
    if by_hand is not None:
        content = _merged(content, by_hand, f"task {name}: by_hand.yaml")
    timing = _timing(content)
    try:
        file = TaskFile.model_validate(content, context=timing)
    except ValidationError as error:
        parts = right_parts(TaskFile, content, timing)
        return Reading(None, parts, (*_lines(error), *check_entries(parts, timing)))
    parts = as_parts(file)
    errors = tuple(check_entries(parts, timing))
    return Reading(None if errors else file, parts, errors)


def _merged(content: Any, by_hand: str, place: str) -> Any:
    """The content of both files. Raises `UsageError` if the second has a key that is not its own, or in both files."""
    more = load_yaml(by_hand, place)
    if not isinstance(more, Mapping):
        raise UsageError(f"{place}: expected a mapping, {{key: value}}")
    if not isinstance(content, Mapping):
        return content  # the model then raises the error
    for key in more:
        if key not in BY_HAND:
            raise UsageError(f"{place}: {one_line(key)}: the keys of this file are {', '.join(BY_HAND)}")
        if key in content:
            raise UsageError(f"{place}: {key}: task.yaml has it too; leave it in one of the two files")
    return {**content, **more}


def read_task_file(text: str, name: str) -> TaskFile:
    """A task file's text, checked by itself, without its system. Raises `UsageError` that lists every error."""
    reading = read(text, name)
    if reading.file is None:
        raise errors_of(name, reading.errors)
    return reading.file


def errors_of(name: str, errors: Sequence[str], by_hand: str | None = None) -> UsageError:
    lines = "\n".join(errors).replace("\n", "\n  ")
    files = "task.yaml" if by_hand is None else "task.yaml with by_hand.yaml"
    return UsageError(f"task {name}: {files} has errors:\n  {lines}")


def _timing(content: Any) -> Timing:
    """How the file's intervals are read, by its `time`, `sampling_time` and `steps`."""
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
"""Pydantic also names the type at a place that may have values of several types."""


def _lines(error: ValidationError) -> Iterator[str]:
    for item in error.errors():
        parts = [str(part) for part in item["loc"]]
        message = in_words(item["msg"])
        if item["type"] == "extra_forbidden":
            message = f"there is no such key{did_you_mean(parts[-1], fields_at(TaskFile, parts[:-1]))}"
        place = ".".join(part for part in parts if not _TYPE.match(part))
        yield f"{place}: {message}" if place else message


_WRONG = object()


def right_parts(kind: type[BaseModel], content: Any, timing: Timing) -> dict[str, Any]:
    """The entries of `content` that are as `kind` says, and the defaults of those that are left out."""
    parts = {
        name: field.get_default(call_default_factory=True)
        for name, field in kind.model_fields.items()
        if not field.is_required()
    }
    for name, value in content.items() if isinstance(content, Mapping) else ():
        if (field := kind.model_fields.get(name)) is not None:
            declared = Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation
            parts[name] = _right(declared, value, timing)
    return {name: as_parts(value) for name, value in parts.items() if value is not _WRONG}


def _right(declared: Any, value: Any, timing: Timing) -> Any:
    """The value as declared, its right parts, or `_WRONG`."""
    several = _without_none(declared)
    if isinstance(several, type) and issubclass(several, BaseModel):
        return None if value is None else right_parts(several, value, timing)
    if get_origin(several) is dict and isinstance(value, Mapping):
        parts = {str(name): _right(get_args(several)[1], item, timing) for name, item in value.items()}
        return {name: None if part is _WRONG else part for name, part in parts.items()}  # the names count
    if get_origin(several) is tuple and get_args(several)[-1] is Ellipsis and isinstance(value, list | tuple):
        items = [_right(get_args(several)[0], item, timing) for item in value]
        return tuple(item for item in items if item is not _WRONG)
    try:
        return TypeAdapter(declared).validate_python(value, context=timing)
    except ValidationError:
        return _WRONG


def _without_none(declared: Any) -> Any:
    if get_origin(declared) is Annotated:
        return _without_none(get_args(declared)[0])
    if get_origin(declared) in (Union, UnionType):
        others = [part for part in get_args(declared) if part is not NoneType]
        return _without_none(others[0]) if len(others) == 1 else declared
    return declared


def fields_at(kind: type[BaseModel], place: Iterable[str]) -> Iterable[str]:
    """The keys that a mapping of the file can have, by its place: `signals`, `x` has those of a signal."""
    declared: Any = kind
    for name in place:
        several = _without_none(declared)
        if isinstance(several, type) and issubclass(several, BaseModel):
            declared = several.model_fields[name].annotation
        else:
            declared = get_args(several)[1 if get_origin(several) is dict else 0]
    model: type[BaseModel] = _without_none(declared)
    return model.model_fields


def as_parts(value: Any) -> Any:
    """A value of a file, with mappings in the place of models."""
    if isinstance(value, BaseModel):
        return {name: as_parts(getattr(value, name)) for name in type(value).model_fields}
    if isinstance(value, Mapping):
        return {name: as_parts(item) for name, item in value.items()}
    return tuple(map(as_parts, value)) if isinstance(value, tuple) else value


def code_of(home: Path) -> tuple[str, ...]:
    """The code that the folder of a task runs, in a few words each; none if it is data alone.

    Ask it before the folder is known (`named_tasks.know`) if the user did not name that folder as a task. Raises
    `UsageError` as `file_of`.
    """
    environment = file_of(home).environment
    files = sorted(path.name for path in home.iterdir() if path.suffix.lower() == ".py")
    return (*files, *(imported(environment) if environment else ()))


def file_of(home: Path) -> TaskFile:
    """The task file of a folder, by itself. Raises `UsageError` if there is none, or it has errors."""
    path = home / TASK_FILE
    try:
        return read_task_file(path.read_text(encoding="utf-8"), home.name)
    except (OSError, UnicodeError) as error:
        raise UsageError(f"cannot read {path}: {error}") from error


def imported(environment: Environment) -> Iterator[str]:
    """The texts that have a module imported: an id that says where it is registered, or a text among the arguments.

    An id that an installed package has registered is none. Environments may import the thing that a text names, as a
    class of vehicles, or make another environment of it.
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
