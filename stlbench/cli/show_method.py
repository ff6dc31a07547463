"""`stlbench show method`: what a reward method is, its parameters, and which formulas it takes."""

from __future__ import annotations

import inspect
import sys
from typing import Annotated, Any

import typer

from stlbench.cli.common import Json, console, print_json
from stlbench.cli.completion import names


def method(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="As `stlbench list methods` says.", autocompletion=names("methods"))
    ],
    as_json: Json = False,
) -> None:
    """Show a reward method: description, source, parameters with their meaning, and which formulas it does not take.

    \b
    Examples:
      stlbench show method funnel
      stlbench show method flag --json
    """
    shown = facts(name)
    if as_json:
        print_json(shown)
    else:
        _print(shown)


def facts(name: str) -> dict[str, Any]:
    """All that is shown, as plain values; from the class's docstring and the signature of its constructor."""
    from stlbench.registry import docstrings, plugins
    from stlbench.registry.field_docs import field_docs

    plugin = plugins.find("methods", name)
    kind = plugin.load()
    docstring = docstrings.read(kind)
    meanings = {**docstring.parameters, **field_docs(kind)}
    return {
        "name": name,
        "distribution": plugin.distribution,
        "version": plugin.version,
        "class": plugin.entry_point.value,
        "source": (inspect.getdoc(sys.modules[kind.__module__]) or "").partition("\n")[0],
        "description": docstring.text,
        "parameters": {
            parameter: {
                "type": text,
                **({} if default is inspect.Parameter.empty else {"default": default}),
                "meaning": meanings.get(parameter, ""),
            }
            for parameter, (text, default) in plugins.parameters(plugin).items()
        },
        "limits": dict(docstring.raises),
    }


def _print(shown: dict[str, Any]) -> None:
    from stlbench.report import Column, Table, to_screen

    typer.echo(f"{shown['name']} ({shown['distribution']} {shown['version']}, {shown['class']})")
    for text in (shown["source"], shown["description"]):
        if text:
            typer.echo(f"\n{text}")
    typer.echo()
    out = console()
    parameters = tuple(
        (name, parameter["type"], str(parameter.get("default", "required")), parameter["meaning"])
        for name, parameter in shown["parameters"].items()
    )
    tables = {
        "Parameters": (("name", "type", "default", "meaning"), parameters),
        "Where it does not fit": (("status", "where"), tuple((key.lower(), at) for key, at in shown["limits"].items())),
    }
    for title, (headings, rows) in tables.items():
        if rows:
            to_screen(Table(title, tuple(Column(heading, right=False) for heading in headings), rows), out)
