"""`stlbench list`: the installed plugins, and their distributions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stlbench.cli.common import Json, show, warn
from stlbench.cli.show import parameter_facts
from stlbench.errors import UsageError, did_you_mean

if TYPE_CHECKING:
    from stlbench.report import Table


def list_plugins(
    kind: Annotated[str, typer.Argument(metavar="KIND", help="methods, tasks, agents, executors or logs.")],
    as_json: Json = False,
) -> None:
    """List the installed methods, tasks, agents, executors or logs.

    Each with the distribution that it comes from and its parameters, which `run` takes in brackets. A plugin that
    cannot be loaded is a warning.

    \b
    Examples:
      stlbench list methods
      stlbench list tasks --json
    """
    from stlbench.registry import plugins

    if kind not in plugins.KINDS:
        raise UsageError(f"no kind of plugin '{kind}'{did_you_mean(kind, plugins.KINDS)}")
    listed = []
    for plugin in plugins.available(kind).values():
        try:
            facts = {"name": plugin.name, "distribution": plugin.distribution, "version": plugin.version}
            listed.append(facts | {"summary": plugin.summary, "parameters": parameter_facts(plugin)})
        except plugins.PluginError as error:
            warn(str(error))
    show(as_json, listed, _text(kind, listed))


def _text(kind: str, listed: list[dict[str, Any]]) -> Iterator[Table]:
    from stlbench.report import Column, Table

    titles = ["name", "from", "summary", *(["parameters"] if any(facts["parameters"] for facts in listed) else [])]
    rows = tuple(
        (facts["name"], f"{facts['distribution']} {facts['version']}", facts["summary"], _parameters(facts))
        for facts in listed
    )
    columns = tuple(Column(title, right=False) for title in titles)
    yield Table(kind.capitalize(), columns, tuple(row[: len(titles)] for row in rows))


def _parameters(facts: dict[str, Any]) -> str:
    texts = []
    for name, parameter in facts["parameters"].items():
        default = f" = {parameter['default']}" if "default" in parameter else ", required"
        texts.append(f"{name}: {parameter['type']}{default}")
    return "\n".join(texts)
