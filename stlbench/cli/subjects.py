"""What `falsify` and `certify` search: cells of a folder of results by their stored policies, and hand controllers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stlbench.cli.common import warn
from stlbench.errors import UsageError

if TYPE_CHECKING:
    from stlbench.result import Result
    from stlbench.rollout.saved_policies import Which
    from stlbench.search.subject import Subject
    from stlbench.study.results import Results

__all__ = ["All", "Budget", "Cells", "Controller", "Final", "RunFolder", "subjects"]

Cells = Annotated[
    list[str] | None,
    typer.Argument(metavar="[CELL]...", help="task/method/agent/seed, as the run's lines name it; several will do."),
]
RunFolder = Annotated[Path, typer.Option("--results", metavar="DIR", help="A folder that `stlbench run` wrote.")]
All = Annotated[bool, typer.Option("--all", help="All cells of the folder that have a stored policy.")]
Controller = Annotated[
    str | None, typer.Option(metavar="LIST", help="Tasks whose controllers by hand are searched, a comma list.")
]
Budget = Annotated[
    str | None, typer.Option(metavar="NAME", help="Budget of the cells.", show_default="the only one in DIR")
]
Final = Annotated[bool, typer.Option("--final", help="The policy at the end of training, not the selected one.")]


def subjects(
    cells: list[str] | None, folder: Path, budget: str | None, every: bool, final: bool, controllers: str | None
) -> list[Subject]:
    """All that the options name. Raises `UsageError` where they name nothing, or what cannot act."""
    from stlbench.registry.folders import parse_tasks
    from stlbench.search.subject import of_controller
    from stlbench.task import load_task

    named = [of_controller(load_task(task)) for task in parse_tasks(controllers)] if controllers else []
    named += _stored(cells or [], folder, budget, every, final) if cells or every else []
    if not named:
        raise UsageError("name a cell, --all for all cells of a folder of results, or a task by --controller")
    return named


def _stored(cells: list[str], folder: Path, budget: str | None, every: bool, final: bool) -> list[Subject]:
    """The policies of the named cells, or of all that have one."""
    from stlbench.study.results import Results

    if cells and every:
        raise UsageError("name cells or say --all, not both")
    results, which = Results.load(folder), _which(final)
    if cells:
        return [_subject(results, results.cell(name, budget), which) for name in cells]
    kept = [result for result in results if _kept(result) and budget in (None, result.id.budget)]
    found: list[Subject] = []
    for result in kept:
        try:
            found.append(_subject(results, result, which))
        except UsageError as error:
            warn(str(error))
    if not found:
        rest = f" and the budget {budget}" if budget else ""
        raise UsageError(f"{folder} has no cell with a stored policy that can be used{rest}")
    return found


def _which(final: bool) -> Which:
    return "final" if final else "selected"


def _kept(result: Result) -> bool:
    return result.measurement is not None and result.measurement.policies is not None


def _subject(results: Results, result: Result, which: Which) -> Subject:
    from stlbench.search.subject import of_policy

    kept = results.policy(result.id, which=which)
    last = [which] if which == "final" else []
    label = (*result.id.name.split("/"), result.id.budget, *last)
    return of_policy(", ".join([result.id.name, *last]), label, kept.task, kept.method, kept.policy)
