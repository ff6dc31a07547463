"""What the docstring of a plugin's class says: a text, and the items of its sections `Args` and `Raises`."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from textwrap import dedent

_SECTION = re.compile(r"^(Args|Raises):$", re.MULTILINE)
_ITEM = re.compile(r"^(\w+): (.*(?:\n(?: .*|$))*)", re.MULTILINE)


@dataclass(frozen=True)
class Docstring:
    """A docstring in Google's style, taken apart. The texts of items are single lines."""

    text: str
    """All before the first section."""
    parameters: Mapping[str, str] = field(default_factory=dict)
    """Parameter -> what it means."""
    raises: Mapping[str, str] = field(default_factory=dict)
    """Exception -> when."""


def read(kind: type) -> Docstring:
    """The docstring of a class; one without it, or without sections, has little to say."""
    text, *parts = _SECTION.split(inspect.getdoc(kind) or "")
    sections = {name: _items(body) for name, body in zip(parts[::2], parts[1::2], strict=True)}
    return Docstring(text.strip(), sections.get("Args", {}), sections.get("Raises", {}))


def _items(body: str) -> dict[str, str]:
    return {name: " ".join(text.split()) for name, text in _ITEM.findall(dedent(body.strip("\n")))}
