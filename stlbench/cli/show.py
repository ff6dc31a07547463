"""`stlbench list` and `stlbench show`: the installed plugins, and one cell, method or task in full."""

import inspect
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from stlbench.cli import output
from stlbench.cli.common import warn
from stlbench.cli.options import Budget, Cell, Folder, completed
from stlbench.cli.output import Json, table
from stlbench.cli.show_task import task
from stlbench.errors import UsageError, did_you_mean, one_line
from stlbench.records.identity import OUTSIDE
from stlbench.records.result import ACCIDENTS, Result, to_json
from stlbench.records.result_files import cell_files, end_of_log, is_there
from stlbench.registry import choices, plugins
from stlbench.registry.choices import field_docs
from stlbench.registry.plugins import Plugin
from stlbench.report.tables.runs import scores_and_cost
from stlbench.report.tables.table import Table
from stlbench.study.results import Results
from stlbench.study.study import json_schema

app = typer.Typer(rich_markup_mode=None)
app.command("task")(task)


@app.callback()
def show() -> None:
    """Show one thing in full, such as a task.

    \b
    Example:
      stlbench show task reach-stay
    """


@app.command("cell")
def cell(name: Cell, folder: Folder = Path("results"), budget: Budget = None, as_json: Json = False) -> None:
    """Show one cell of a folder of results: status, reason and traceback, provenance, scores, cost.

    \b
    Examples:
      stlbench show cell reach-stay/funnel/dqn/0
      stlbench show cell "overlap[without=cuts]/funnel/dqn/1" results/ablation --json
    """
    results = Results.load(folder)
    result = results.cell(name, budget)
    output.show(as_json, cell_facts(result, results.folder), _cell_text(result, results.folder))


def cell_facts(result: Result, folder: Path) -> dict[str, Any]:
    """The whole record of a cell of a folder as JSON values; `log` is the path of its output."""
    content: dict[str, Any] = json.loads(to_json(result))
    log = cell_files(folder, result.id, result.key).log
    return {"name": result.id.name, **content, "log": str(log) if is_there(log, folder) else None}


def _cell_text(result: Result, folder: Path) -> Iterator[str | Table]:
    log = cell_files(folder, result.id, result.key).log
    parts = {
        "cell": result.id.name,
        "budget": result.id.budget,
        "status": result.status,
        "reason": result.reason,
        "key": result.key,
        "log": str(log) if is_there(log, folder) else "",
        **result.provenance,
    }
    width = max(map(len, parts)) + 1
    yield from (f"{name + ':':{width}} {text}" for name, text in parts.items() if text)
    if result.details:
        yield f"\n{result.details.rstrip()}"
    if result.status in ACCIDENTS and (end := end_of_log(log, folder)):
        yield "\nthe end of its log:"
        yield from end
    if result.measurement is not None:
        yield ""
        yield from scores_and_cost(result.measurement, outside=result.id.track == OUTSIDE)


@app.command("schema")
def schema(
    kind: Annotated[Literal["task", "study"], typer.Argument(metavar="KIND", help="task or study.")],
) -> None:
    """Show the JSON schema of a task file or a study file, by which editors complete and check it.

    \b
    Example:
      stlbench show schema task > task.schema.json
    """
    typer.echo(json.dumps(json_schema(kind), indent=2, ensure_ascii=False))


@app.command("method")
def method(
    name: Annotated[
        str,
        typer.Argument(metavar="NAME", help="Name of a reward method.", autocompletion=completed("methods")),
    ],
    as_json: Json = False,
) -> None:
    """Show a reward method: description, source, parameters with their meaning, and which formulas it does not take.

    \b
    Examples:
      stlbench show method funnel
      stlbench show method flag --json
    """
    facts = _method_facts(name)
    output.show(as_json, facts, _method_text(facts))


def parameter_facts(plugin: Plugin) -> dict[str, dict[str, Any]]:
    return {
        name: {"type": each.text} | ({} if each.default is inspect.Parameter.empty else {"default": each.default})
        for name, each in plugins.parameters(plugin).items()
    }


def _method_facts(name: str) -> dict[str, Any]:
    plugin = plugins.find("methods", name)
    kind = plugin.load()
    docstring = choices.read(kind)
    meanings = {**docstring.parameters, **field_docs(kind)}
    return {
        "name": name,
        "distribution": plugin.distribution,
        "version": plugin.version,
        "class": plugin.entry_point.value,
        "source": one_line((inspect.getdoc(sys.modules[kind.__module__]) or "").partition("\n")[0]),
        "description": docstring.text,
        "parameters": {
            parameter: facts | {"meaning": meanings.get(parameter, "")}
            for parameter, facts in parameter_facts(plugin).items()
        },
        "limits": dict(docstring.raises),
    }


def _method_text(facts: Mapping[str, Any]) -> Iterator[str | Table]:
    yield f"{facts['name']} ({facts['distribution']} {facts['version']}, {facts['class']})"
    yield from (f"\n{text}" for text in (facts["source"], facts["description"]) if text)
    yield ""
    parameters = [
        {
            "name": name,
            "type": each["type"],
            "default": str(each.get("default", "required")),
            "meaning": each["meaning"],
        }
        for name, each in facts["parameters"].items()
    ]
    limits = [{"status": status.lower(), "where": place} for status, place in facts["limits"].items()]
    yield from (table(*part) for part in (("Parameters", parameters), ("Where it does not fit", limits)) if part[1])


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
    if kind not in plugins.KINDS:
        raise UsageError(f"no kind of plugin '{kind}'{did_you_mean(kind, plugins.KINDS)}")
    listed = []
    for plugin in plugins.available(kind).values():
        try:
            facts = {"name": plugin.name, "distribution": plugin.distribution, "version": plugin.version}
            listed.append(facts | {"summary": plugin.summary, "parameters": parameter_facts(plugin)})
        except plugins.PluginError as error:
            warn(str(error))
    output.show(as_json, listed, [table(kind.capitalize(), list(_rows(listed)))])


def _rows(listed: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, str]]:
    parametrised = any(facts["parameters"] for facts in listed)
    for facts in listed:
        row = {
            "name": facts["name"],
            "from": f"{facts['distribution']} {facts['version']}",
            "summary": facts["summary"],
        }
        yield row | ({"parameters": _parameters(facts)} if parametrised else {})


def _parameters(facts: Mapping[str, Any]) -> str:
    return "\n".join(
        f"{name}: {each['type']}" + (f" = {each['default']}" if "default" in each else ", required")
        for name, each in facts["parameters"].items()
    )
