"""`stlbench advise`: which reward methods fit a task's formula, why others do not, and what results say of them."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from stlbench.cli.common import Json, show, warn
from stlbench.cli.options import completed
from stlbench.errors import UsageError, cause, one_line

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from stlbench.contract import RewardMethod, Specification
    from stlbench.report import Table
    from stlbench.task.task import Task

_NOTES = (
    "Inputs: what the policy sees beside features and time. Memory: what the method carries from step to step.",
    "Also: 'counterfactuals' are learned from by dqn; 'ends' means that training episodes end where all is decided.",
    "Outside its source's form, a method is an extension of ours: see the reason, and its page in the documentation.",
)
_COMPARISON = re.compile("[<>]")
"""Each formula has one, and no task's name."""
_NUMBER = re.compile(r"\d+(?:\.\d*)?(?:[eE][+-]?\d+)?")
_ASK = "Parameters can be asked for: --methods 'hprs[later=target],tau-mdp[every=10]'."


def advise(
    name: Annotated[
        str,
        typer.Argument(
            metavar="TASK_OR_FORMULA", help="A task, or a formula in steps.", autocompletion=completed("tasks")
        ),
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
    """Which reward methods fit a formula, and why the others do not.

    A formula without a task has no ranges: each signal is taken to lie within ten times the formula's largest constant.
    With --results, what the methods reached there: with the task's own agent, on the track shared, the best first.
    Methods with parameters that were run there are asked about too.

    \b
    Examples:
      stlbench advise reach-stay
      stlbench advise "G[400,700] (abs(theta) <= 0.05)"
      stlbench advise robot-nav --methods "tau-mdp,tau-mdp[every=10],hprs[later=target]"
      stlbench advise reach-stay --results results/reference --json
    """
    from stlbench.contract import Specification
    from stlbench.registry import plugins
    from stlbench.registry.choices import parse_choices
    from stlbench.task import load_task

    task = _alone(name) if _COMPARISON.search(name) else load_task(name)
    if results is not None and isinstance(task, Specification):
        raise UsageError("--results is of a task's results; name the task instead of a formula")
    known = {} if results is None or isinstance(task, Specification) else _known(task, results)
    chosen = None if methods is None else parse_choices(methods)
    for choice in chosen or ():
        plugins.check("methods", choice)
    facts = _facts(task, known, None if chosen is None else list(map(str, chosen)))
    show(as_json, facts, _text(facts, bool(known)))


def _alone(text: str) -> Specification:
    """What methods are told of a formula without a task."""
    from stlbench import stl
    from stlbench.contract import Specification
    from stlbench.stl.language.structure import unbounded, walk

    try:
        formula = stl.parse(text)
    except (TypeError, ValueError) as error:
        raise UsageError(f"formula: {one_line(error)}") from error
    if (endless := unbounded(formula)) is not None:
        raise UsageError(f"formula: {endless} has no end without a task; give its interval in steps, as in G[0,100]")
    predicates = " ".join(str(node) for node in walk(formula) if isinstance(node, stl.Predicate))
    largest = 10 * max([1.0, *map(float, _NUMBER.findall(predicates))])
    names = stl.signals(formula)
    ends = (largest,) * len(names)
    return Specification(formula, names, tuple(-end for end in ends), ends, max(1, stl.horizon(formula)), 1.0)


def _facts(
    task: Task | Specification, known: Mapping[str, Mapping[str, Any]], methods: Iterable[str] | None
) -> dict[str, Any]:
    """The task's formula in its forms, the methods that fit, and the methods that do not.

    Asked are these `methods`, or all that are installed or `known` from results.
    """
    from stlbench.contract import Specification
    from stlbench.registry import plugins

    rows = list(_rows(task, methods or dict.fromkeys([*plugins.available("methods"), *known]), known))
    fitting = [row for row in rows if "status" not in row]
    fitting.sort(key=lambda row: (_rank(row.get("known")), row["extension"] != "", row["inputs"]))
    refused = [row for row in rows if "status" in row]
    given = task if isinstance(task, Specification) else task.specification
    return {
        "task": None if isinstance(task, Specification) else task.name,
        "formula": str(task.formula),
        "rewarded": str(given.formula),
        "nested": None if given.nested is None else str(given.nested),
        "fit": fitting,
        "do_not_fit": refused,
    }


def _rows(
    task: Task | Specification, choices: Iterable[str], known: Mapping[str, Mapping[str, Any]]
) -> Iterator[dict[str, Any]]:
    from stlbench.contract import RewardMethod
    from stlbench.registry import plugins

    for choice in choices:
        try:
            fitted = fit(task, choice)
        except plugins.PluginError as error:
            warn(str(error))
            continue
        if (method := fitted.method) is None:
            yield {"method": choice, "status": fitted.status, "reason": fitted.reason}
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
    """The best first; unknown methods last."""
    return (1, 0) if known is None else (-known["satisfaction"], -known["robustness"])


def _known(task: Task, folder: Path) -> dict[str, dict[str, Any]]:
    """Method -> its scores with the task's own agent on the track shared, at the budget with the most steps."""
    from stlbench.records import stored
    from stlbench.report import condense

    known = dict[str, dict[str, Any]]()
    groups = [group for group in condense(stored.read(folder)) if group.done]
    for group in sorted(groups, key=lambda group: max(group.values("env_steps"))):
        setting = group.setting
        if (setting.task, str(setting.agent), setting.track) != (task.choice, task.own_agent, "shared"):
            continue
        known[str(setting.method)] = {
            "budget": setting.budget,
            "seeds": len(group.done),
            "satisfaction": fmean(group.values("satisfaction")),
            "robustness": fmean(group.values("robustness_mean")),
        }
    if not known:
        own = f"with {task.own_agent} on the track shared"
        raise UsageError(f"{folder} has no finished cell of {task.name} {own}; leave --results out, or name others")
    return known


def _text(facts: Mapping[str, Any], known: bool) -> Iterator[str | Table]:
    from stlbench.report import Column, Table

    yield facts["formula"] if facts["task"] is None else f"{facts['task']}: {facts['formula']}"
    if facts["rewarded"] != facts["formula"]:
        yield f"as methods see it: {facts['rewarded']}"
    if facts["nested"] is not None:
        yield f"as windows: {facts['nested']}"
    yield ""
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
            *(row["method"], row["inputs"], row["memory"], ", ".join(row["also"])),
            *(_known_cells(row.get("known")) if known else ()),
            row["extension"],
        )
        for row in facts["fit"]
    )
    yield Table("Methods that fit", columns, rows, _NOTES)
    refused = tuple((row["method"], row["status"], row["reason"]) for row in facts["do_not_fit"])
    if refused:
        titles = tuple(Column(title, right=False) for title in ("method", "status", "reason"))
        yield Table("Methods that do not", titles, refused, (_ASK,))


def _known_cells(known: Mapping[str, Any] | None) -> tuple[str | int | float | None, ...]:
    if known is None:
        return None, None, None, None
    return known["budget"], known["seeds"], round(100 * known["satisfaction"], 1), round(known["robustness"], 3)


@dataclass(frozen=True)
class Fit:
    """A method that was built for a task, or why it was not."""

    status: Literal["suitable", "unsuitable", "intractable", "raised"]
    method: RewardMethod | None = None
    reason: str = ""


def fit(task: Task | Specification, choice: str) -> Fit:
    """Build a method for a task, as a run does, or for a formula alone. Raises `PluginError` if it cannot be loaded."""
    from stlbench.contract import Intractable, Specification, Unsuitable
    from stlbench.registry import plugins
    from stlbench.task import build_method

    try:
        method = build_method(task, choice)
        if not isinstance(task, Specification):
            _refuse_dear(task, method)
    except plugins.PluginError:
        raise
    except Intractable as reason:
        return Fit("intractable", reason=one_line(reason))
    except (Unsuitable, UsageError) as reason:
        return Fit("unsuitable", reason=one_line(reason))
    except Exception as error:
        return Fit("raised", reason=cause(error))
    return Fit("suitable", method)


def _refuse_dear(task: Task, method: RewardMethod) -> None:
    """Refuse a slow method for the task's own agent and largest budget, if that agent can be built here."""
    from stlbench.contract import Unsuitable
    from stlbench.rollout.cost import refuse_dear
    from stlbench.task import build_agent

    with suppress(Unsuitable, UsageError):
        agent = build_agent(task, task.own_agent)
        refuse_dear(task, method, agent, max(budget.steps for budget in task.file.budgets.values()))
