"""`stlbench list`: which plugins there are, and where they come from."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stlbench.cli.common import Json, console, print_json, warn
from stlbench.errors import UsageError, did_you_mean

if TYPE_CHECKING:
    from stlbench.registry.plugins import Plugin


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
            listed.append(_facts(plugin))
        except plugins.PluginError as error:
            warn(str(error))
    if as_json:
        print_json(listed)
    else:
        _print(kind, listed)


def _facts(plugin: Plugin) -> dict[str, Any]:
    from stlbench.registry import plugins

    return {
        "name": plugin.name,
        "distribution": plugin.distribution,
        "version": plugin.version,
        "summary": plugin.summary,
        "parameters": {
            name: {"type": text} | ({} if default is inspect.Parameter.empty else {"default": default})
            for name, (text, default) in plugins.parameters(plugin).items()
        },
    }


def _print(kind: str, listed: list[dict[str, Any]]) -> None:
    from stlbench.report import Column, Table, to_screen

    titles = ["name", "from", "summary", *(["parameters"] if any(facts["parameters"] for facts in listed) else [])]
    rows = tuple(
        (facts["name"], f"{facts['distribution']} {facts['version']}", facts["summary"], _parameters(facts))[
            : len(titles)
        ]
        for facts in listed
    )
    to_screen(Table(kind.capitalize(), tuple(Column(title, right=False) for title in titles), rows), console())


def _parameters(facts: dict[str, Any]) -> str:
    texts = []
    for name, parameter in facts["parameters"].items():
        default = f" = {parameter['default']}" if "default" in parameter else ", required"
        texts.append(f"{name}: {parameter['type']}{default}")
    return "\n".join(texts)
