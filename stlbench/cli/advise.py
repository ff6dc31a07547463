"""`stlbench advise`: which reward methods fit a task's formula, why others do not, and what results say of them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stlbench.cli.common import Json, console, print_json, warn
from stlbench.cli.completion import names
from stlbench.cli.fit import fit
from stlbench.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from stlbench.report import Group
    from stlbench.task.task import Task

_NOTES = (
    "Inputs: what the policy sees beside features and time. Memory: what the method carries from step to step.",
    "Also: 'counterfactuals' are learned from by dqn; 'ends' means that training episodes end where all is decided.",
    "Outside its source's form, a method is an extension of ours: see the reason, and its page in the documentation.",
)
_ASK = "Parameters can be asked for: --methods 'hprs[later=target],tau-mdp[every=10]'."


def advise(
    name: Annotated[
        str,
        typer.Argument(metavar="TASK", help="A name, or the path of a task's folder.", autocompletion=names("tasks")),
    ],
    methods: Annotated[
        str | None,
        typer.Option("--methods", metavar="LIST", help="Methods to ask about.", show_default="all that are installed"),
    ] = None,
    results: Annotated[
        Path | None,
        typer.Option("--results", metavar="DIR", help="Results of this task to show beside, as of `stlbench run`."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Which reward methods fit a task's formula, and why the others do not.

    With --results, what the methods reached there: with the task's own agent, on the track shared, the best first.
    Methods with parameters that were run there are asked about too.

    \b
    Examples:
      stlbench advise reach-stay
      stlbench advise robot-nav --methods "tau-mdp,tau-mdp[every=10],hprs[later=target]"
      stlbench advise hold-disc --results results/reference --json
    """
    from stlbench.registry import plugins
    from stlbench.registry.choices import parse_choices
    from stlbench.task import load_task

    task = load_task(name)
    known = {} if results is None else _known(task, results)
    chosen = None if methods is None else parse_choices(methods)
    for choice in chosen or ():
        plugins.check("methods", choice)
    content = facts(task, known, None if chosen is None else list(map(str, chosen)))
    if as_json:
        print_json(content)
    else:
        _print(content, bool(known))


def facts(task: Task, known: Mapping[str, Mapping[str, Any]], asked: Iterable[str] | None = None) -> dict[str, Any]:
    """Formula and its other forms, the methods that fit and those that do not, as plain values.

    Args:
        task: whose formula it is.
        known: of some methods, what results say.
        asked: methods; all that are installed and all that are known where None.
    """
    from stlbench.registry import plugins

    choices = asked or dict.fromkeys([*plugins.available("methods"), *known])
    found = list(_each(task, choices, known))
    fitting = [row for row in found if "status" not in row]
    fitting.sort(key=lambda row: (_rank(row.get("known")), row["extension"] != "", row["inputs"]))
    refused = [row for row in found if "status" in row]
    given = task.specification
    return {
        "task": task.name,
        "formula": str(task.formula),
        "rewarded": str(given.formula),
        "nested": None if given.nested is None else str(given.nested),
        "fit": fitting,
        "do_not_fit": refused,
    }


def _each(task: Task, choices: Iterable[str], known: Mapping[str, Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    from stlbench.contract import RewardMethod
    from stlbench.registry import plugins

    for choice in choices:
        try:
            found = fit(task, choice)
        except plugins.PluginError as error:
            warn(str(error))
            continue
        if (method := found.method) is None:
            yield {"method": choice, "status": found.status, "reason": found.reason}
            continue
        ends = method.can_end and type(method).over is not RewardMethod.over  # some say what an early end is paid alone
        also = {"counterfactuals": method.counterfactuals, "ends": ends}
        yield {
            "method": choice,
            "inputs": method.input_size,
            "memory": method.memory_size,
            "also": [word for word, has in also.items() if has],
            "extension": method.extension,
            **({"known": known[choice]} if choice in known else {}),
        }


def _rank(known: Mapping[str, Any] | None) -> tuple[float, float]:
    """The best first, and then those of which nothing is known."""
    return (1, 0) if known is None else (-known["satisfaction"], -known["robustness"])


def _known(task: Task, folder: Path) -> dict[str, dict[str, Any]]:
    """Method -> what it reached; of several budgets that with the most steps. Raises `UsageError` without any."""
    from stlbench.records import stored
    from stlbench.report import condense

    found = dict[str, dict[str, Any]]()
    groups = [group for group in condense(stored.read(folder)) if _matches(task, group)]
    for group in sorted(groups, key=lambda group: max(group.values(lambda numbers: numbers.env_steps))):
        satisfaction, robustness = (
            sum(values) / len(values)
            for values in (
                group.values(lambda numbers: numbers.satisfaction),
                group.values(lambda numbers: numbers.robustness_mean),
            )
        )
        setting = group.setting
        found[str(setting.method)] = {
            "budget": setting.budget,
            "seeds": len(group.done),
            "satisfaction": satisfaction,
            "robustness": robustness,
        }
    if not found:
        own = f"with {task.own_agent} on the track shared"
        raise UsageError(f"{folder} has no finished cell of {task.name} {own}; leave --results out, or name others")
    return found


def _matches(task: Task, group: Group) -> bool:
    setting = group.setting
    own = str(setting.agent) == task.own_agent and setting.track == "shared"
    return bool(group.done) and own and setting.task == task.choice


def _print(content: dict[str, Any], known: bool) -> None:
    from stlbench.report import Column, Table, to_screen

    typer.echo(f"{content['task']}: {content['formula']}")
    if content["rewarded"] != content["formula"]:
        typer.echo(f"as methods see it: {content['rewarded']}")
    if content["nested"] is not None:
        typer.echo(f"as windows: {content['nested']}")
    typer.echo()
    results = (Column("budget", right=False), Column("seeds"), Column("satisfied %"), Column("robustness"))
    columns = (
        Column("method", right=False),
        Column("inputs"),
        Column("memory"),
        Column("also", right=False),
        *(results if known else ()),
        Column("outside its source's form", right=False),
    )
    rows = tuple(
        (
            row["method"],
            row["inputs"],
            row["memory"],
            ", ".join(row["also"]),
            *(_shown(row.get("known")) if known else ()),
            row["extension"],
        )
        for row in content["fit"]
    )
    to_screen(Table("Methods that fit", columns, rows, _NOTES), console())
    refused = tuple((row["method"], row["status"], row["reason"]) for row in content["do_not_fit"])
    if refused:
        others = tuple(Column(heading, right=False) for heading in ("method", "status", "reason"))
        to_screen(Table("Methods that do not", others, refused, (_ASK,)), console())


def _shown(known: Mapping[str, Any] | None) -> tuple[str | int | float | None, ...]:
    if known is None:
        return None, None, None, None
    return known["budget"], known["seeds"], round(100 * known["satisfaction"], 1), round(known["robustness"], 3)
