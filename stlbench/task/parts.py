"""What of a task file is right by itself, though other entries are wrong: what the checks between entries work on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, TypeAdapter, ValidationError

from stlbench.task.entry import Timing

Parts = Mapping[str, Any]
"""Entry -> its value where it is right; of an entry of several, nested likewise. A wrong value is not there."""

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
    """`X` of `Annotated[X, ...]`, and of `X | None`."""
    if get_origin(declared) is Annotated:
        return _without_none(get_args(declared)[0])
    if get_origin(declared) in (Union, UnionType):
        others = [part for part in get_args(declared) if part is not NoneType]
        return _without_none(others[0]) if len(others) == 1 else declared
    return declared


def fields_at(kind: type[BaseModel], place: Iterable[str]) -> Iterable[str]:
    """The keys that a mapping of the file can have, by where it is: of `signals`, `x` those of a signal."""
    declared: Any = kind
    for name in place:
        several = _without_none(declared)
        if isinstance(several, type) and issubclass(several, BaseModel):
            declared = several.model_fields[name].annotation
        else:
            declared = get_args(several)[1 if get_origin(several) is dict else 0]
    found: type[BaseModel] = _without_none(declared)
    return found.model_fields


def as_parts(value: Any) -> Any:
    """A value of a file, with mappings in the place of models."""
    if isinstance(value, BaseModel):
        return {name: as_parts(getattr(value, name)) for name in type(value).model_fields}
    if isinstance(value, Mapping):
        return {name: as_parts(item) for name, item in value.items()}
    return tuple(map(as_parts, value)) if isinstance(value, tuple) else value
