"""The documentation in a plugin's class: its docstring with `Args` and `Raises`, and the texts below fields."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from textwrap import dedent

from stlbench.errors import PAGE, one_line, printable

_SECTION = re.compile(r"^(Args|Raises):$", re.MULTILINE)
_ITEM = re.compile(r"^(\w+): (.*(?:\n(?: .*|$))*)", re.MULTILINE)


@dataclass(frozen=True)
class Docstring:
    """A docstring in Google's style, taken apart. The texts of items are single lines."""

    text: str  # all before the first section
    parameters: Mapping[str, str] = field(default_factory=dict)  # parameter -> what it means
    raises: Mapping[str, str] = field(default_factory=dict)  # exception -> when


def read(kind: type) -> Docstring:
    """The docstring of a class; one without it, or without sections, has little to say."""
    text, *parts = _SECTION.split(printable(inspect.getdoc(kind) or ""))
    sections = {name: _items(body) for name, body in zip(parts[::2], parts[1::2], strict=True)}
    return Docstring(text.strip(), sections.get("Args", {}), sections.get("Raises", {}))


def _items(body: str) -> dict[str, str]:
    return {name: " ".join(text.split()) for name, text in _ITEM.findall(dedent(body.strip("\n")))}


def field_docs(kind: type) -> dict[str, str]:
    """Field -> the text below it, in one line; those of a base class too, where a subclass says nothing new.

    A class without source has none.
    """
    docs = dict[str, str]()
    for owner in reversed(kind.__mro__):
        docs |= _own(owner)
    return docs


@cache
def _own(owner: type) -> dict[str, str]:
    try:
        tree = ast.parse(dedent(inspect.getsource(owner)))
    except (OSError, TypeError, SyntaxError):
        return {}
    body = tree.body[0].body if isinstance(tree.body[0], ast.ClassDef) else []
    return {
        field.target.id: one_line(below.value.value, PAGE)
        for field, below in pairwise(body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant) and isinstance(below.value.value, str)
    }
