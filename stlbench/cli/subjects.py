"""What `falsify` and `certify` search: stored policies of cells, hand controllers, and policies from outside."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import typer

from stlbench.cli.common import warn
from stlbench.errors import UsageError

if TYPE_CHECKING:
    from stlbench.records.result import Result
    from stlbench.search.subject import Subject
    from stlbench.share.scoring import Shown
    from stlbench.study.results import Results
    from stlbench.task import Task

Policies = Annotated[
    list[str] | None,
    typer.Argument(metavar="[CELL]...", help="task/method/agent/seed, as the run's lines name it; with --task POLICY."),
]
RunFolder = Annotated[Path, typer.Option("--results", metavar="DIR", help="A folder that `stlbench run` wrote.")]
All = Annotated[bool, typer.Option("--all", help="All cells of the folder that have a stored policy.")]
Controller = Annotated[
    str | None, typer.Option(metavar="LIST", help="Tasks whose controllers by hand are searched, a comma list.")
]
Budget = Annotated[
    str | None, typer.Option(metavar="NAME", help="Budget of the cells.", show_default="the only one in DIR")
]
Which = Annotated[Literal["selected", "final"], typer.Option("--policy", help="Which of a cell's two policies.")]
TaskName = Annotated[
    str | None,
    typer.Option("--task", metavar="TASK", help="Search policies from outside on it, named as in `stlbench score`."),
]
Method = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="With --task: method whose inputs the policy is shown.", show_default="none"),
]
On = Annotated[
    Literal["observation", "state", "environment"],
    typer.Option(help="With --task: what the policy is given: as agents, states and steps, or the environment's own."),
]


class Named(NamedTuple):
    """What the options name."""

    policies: list[str]
    """Cells; with a task, policies from outside."""
    results: Path
    every: bool
    controllers: str | None
    budget: str | None
    which: Literal["selected", "final"]
    task: str | None
    method: str | None
    on: Literal["observation", "state", "environment"]


def subjects(named: Named) -> list[Subject]:
    """All that the options name. Raises `UsageError` where they name nothing, or what cannot act."""
    if named.every and (named.policies or named.task):
        raise UsageError("--all means all cells of the folder: name no others beside it")
    if named.task is None and (named.method is not None or named.on != "observation"):
        raise UsageError("--method and --on are for policies from outside, with --task")
    found = _by_hand(named.controllers) if named.controllers else []
    if named.task is not None:
        found += _outside(named, named.task)
    elif named.policies or named.every:
        found += _stored(named)
    if not found:
        raise UsageError("name a cell, --all for all cells of a folder of results, or a task by --controller")
    return found


def _by_hand(controllers: str) -> list[Subject]:
    from stlbench.registry.folders import parse_tasks
    from stlbench.search.subject import foreign, of_controller
    from stlbench.task import load_task

    found = []
    for task in parse_tasks(controllers):
        with foreign(f"{task}, by hand"):
            found.append(of_controller(load_task(task)))
    return found


def _outside(named: Named, name: str) -> list[Subject]:
    """The policies from outside, each on the task."""
    from stlbench.registry.choices import parse_choice
    from stlbench.registry.folders import task_of
    from stlbench.search.subject import foreign
    from stlbench.share.scoring import UNKNOWN, Shown
    from stlbench.task import load_task

    if not named.policies:
        raise UsageError("--task needs a policy: module:function, or a file .zip (SB3) or .onnx")
    shown = Shown(named.on, UNKNOWN if named.method is None else parse_choice(named.method))
    with foreign(f"task {name}"):
        task = load_task(task_of(name))
    return [_from_outside(task, policy, shown) for policy in named.policies]


def _from_outside(task: Task, policy: str, shown: Shown) -> Subject:
    from stlbench.search.subject import foreign, of_policy
    from stlbench.share.scoring import acting
    from stlbench.share.source import find_source

    source = find_source(policy)
    if source.kind in ("cell", "traces"):
        what = "a cell: name it without --task" if source.kind == "cell" else "recorded traces, which cannot act"
        raise UsageError(f"{policy} is {what}")
    called = f"{task.name}, {source.shown}"
    with foreign(called):
        method, acts = acting(task, source, shown)
    return of_policy(called, (task.name, source.name), task, method, acts)


def _stored(named: Named) -> list[Subject]:
    """The policies of the named cells, or of all that have one."""
    from stlbench.study.results import Results

    results = Results.load(named.results)
    if named.policies:
        return [_subject(results, results.cell(name, named.budget), named.which) for name in named.policies]
    found: list[Subject] = []
    for result in results:
        if _kept(result) and named.budget in (None, result.id.budget):
            try:
                found.append(_subject(results, result, named.which))
            except UsageError as error:
                warn(str(error))
    if not found:
        rest = f" and the budget {named.budget}" if named.budget else ""
        raise UsageError(f"{named.results} has no cell with a stored policy that can be used{rest}")
    return found


def _kept(result: Result) -> bool:
    return result.measurement is not None and result.measurement.policies is not None


def _subject(results: Results, result: Result, which: Literal["selected", "final"]) -> Subject:
    from stlbench.search.subject import foreign, of_policy

    last = [which] if which == "final" else []
    called, label = ", ".join([result.id.name, *last]), (*result.id.name.split("/"), result.id.budget, *last)
    with foreign(called):
        kept = results.policy(result.id, which=which)
    return of_policy(called, label, kept.task, kept.method, kept.policy)
