"""A hook of mkdocs: tables of parameters, made from the plugins themselves.

`<!-- parameters: agents dqn -->` in a page becomes the table of that plugin: the fields of its dataclass, each with
type and range, default and docstring. Of a reward method it is what its docstring says of the constructor's arguments.
"""

from __future__ import annotations

import re
from typing import Any

from stlbench.registry import choices, plugins
from stlbench.registry.choices import Parameter, declared, field_docs

_PLACE = re.compile(r"^<!-- parameters: (\w+) (\S+) -->$", re.MULTILINE)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Called by mkdocs for each page."""
    return _PLACE.sub(lambda place: table(place[1], place[2]), markdown)


def table(kind: str, name: str) -> str:
    """The parameters of a plugin as a table in Markdown. Raises `UsageError` where there is no such plugin."""
    plugin = plugins.find(kind, name).load()
    docs = {**choices.read(plugin).parameters, **field_docs(plugin)}
    lines = ["| parameter | type | default | meaning |", "|---|---|---|---|"]
    for key, parameter in declared(plugin).items():
        lines.append(f"| `{key}` | {_type(parameter)} | `{_default(parameter)}` | {docs.get(key, '')} |")
    return "\n".join(lines)


def _type(parameter: Parameter) -> str:
    limits = f", {parameter.limits}" if parameter.limits else ""
    return f"{parameter.text.replace(' | ', ' or ')}{limits}".replace("<", "&lt;")


def _default(parameter: Parameter) -> str:
    default = parameter.default
    return "+".join(map(str, default)) if isinstance(default, tuple) else str(default)
