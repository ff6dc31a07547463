"""YAML from a user: plain values, or what is wrong with the text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml

from stlbench.errors import UsageError, cause, one_line, printable

_MERGE = "tag:yaml.org,2002:merge"

MOST = 200_000
"""Values that a file may have, each alias counted as what it stands for."""


def load_yaml(text: str, place: str) -> Any:
    """The content of a text, which comes from `place`. It has the escapes of characters that no terminal takes.

    Raises:
        UsageError: it is no YAML, a mapping has a key twice, a value is none of its type (2001-99-99), a text is none
            ("\\ud800"), it nests too deep, or a few aliases make more of it than any file would have.
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
    except Exception as error:  # of a value: a ValueError of a date, a KeyError of a word that should be true or false
        raise UsageError(f"{place} is no YAML: a value is none of its type ({cause(error)})") from error
    if size > MOST:
        raise UsageError(f"{place} has more than {MOST} values, or an alias inside of what it stands for")
    return content


class _TwiceError(Exception):
    """Which key, and where."""


def _loaded(text: str) -> Any:
    loader = yaml.SafeLoader(text)
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
    """How many values there are in it. A value within itself has too many."""
    if not isinstance(value, Mapping | list | set | tuple):
        return 1
    if id(value) not in known:
        known[id(value)] = MOST + 1
        parts = [*value, *value.values()] if isinstance(value, Mapping) else value
        known[id(value)] = 1 + sum(_size(part, known) for part in parts)
    return known[id(value)]
