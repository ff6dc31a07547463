"""`stlbench plan`: what the rewards of a task ask for, by planning, before anything is trained."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stlbench.cli.completion import names
from stlbench.cli.options import Explain, study_options
from stlbench.cli.options import names as choices
from stlbench.cli.run import interruptible, report_cells

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stlbench.records.identity import CellId
    from stlbench.registry.choices import Choice


_RESULTS = "results/plan"


@study_options("methods", "jobs", "results", "executor", "retry", methods=("", "all that fit"), results=("", _RESULTS))
def plan(
    task: Annotated[
        str,
        typer.Argument(metavar="TASK", help="A name, or the path of a task's folder.", autocompletion=names("tasks")),
    ],
    *,
    settings: Annotated[
        str | None,
        typer.Option(
            metavar="LIST",
            help="Settings, a comma list: 'recipe', 'gamma=1', 'without=cuts+ends gamma=1'.",
            show_default="recipe, gamma=1, without each of cuts, ends, rewarded",
        ),
    ] = None,
    resolution: Annotated[
        float | None,
        typer.Option(metavar="X", help="Factor on the points of the grid, per axis.", show_default="1"),
    ] = None,
    explain: Explain = False,
    **options: Any,
) -> None:
    """Say what the rewards of a task ask for: plan for them, and for the formula itself, without training.

    For each method and setting, the policy that is best by the reward is computed on a grid of the state and scored as
    any policy is. The table Alignment compares it with the best known. On a coarse grid (--resolution 0.6) a cell
    takes 2 to 30 seconds for a method without memory. The same command again runs only what is missing.

    \b
    Examples:
      stlbench plan overlap --methods raw,funnel --resolution 0.6
      stlbench plan hold-disc --settings "recipe,gamma=1,without=cuts gamma=1"
    """
    from stlbench.records.status import accidents_of
    from stlbench.registry.folders import task_of
    from stlbench.study.progress import Progress
    from stlbench.study.run import build_executor, run_cells
    from stlbench.study.solve import parse_settings, plan_alignment

    chosen, results = choices(options.get("methods")), Path(options.get("results", _RESULTS))
    cells = plan_alignment(task_of(task), chosen, None if settings is None else parse_settings(settings), resolution)
    executor, retry = build_executor(options.get("executor", "local"), options.get("jobs")), options.get("retry")
    with interruptible(lambda: cells, results), Progress(results) as progress:
        run_cells(cells, results, executor, retry=accidents_of(retry), progress=progress)
    _say_equal([cell.id for cell in cells], chosen)
    report_cells({cell.id for cell in cells}, results, explain)


def _say_equal(cells: Sequence[CellId], methods: Sequence[Choice] | None) -> None:
    """Which of the methods pay for the same on the task, and on those of its ablations that reward another form."""
    from stlbench.registry import plugins
    from stlbench.rollout.standards import differences
    from stlbench.study.plugin_guard import ask
    from stlbench.task import load_task

    seen = set[object]()
    for task in dict.fromkeys(cell.task for cell in cells):
        loaded = load_task(task)
        if loaded.specification.formula not in seen:
            seen.add(loaded.specification.formula)
            for difference in differences(task, plugins.available("methods") if methods is None else methods, ask):
                typer.echo(f"{task}: {difference}")
