"""`stlbench run` and `stlbench plan`: plan the cells, run those that are missing, show the tables."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from stlbench.cli.common import DISK_FULL, refuse
from stlbench.cli.options import Explain, TaskName, Verbose, study_options
from stlbench.cli.options import names as choices
from stlbench.cli.report import show_report
from stlbench.errors import DiskFull, UsageError
from stlbench.records import stored
from stlbench.records.identity import CellId
from stlbench.records.ledger import FILE, Ledger
from stlbench.records.status import ACCIDENTS, accidents_of
from stlbench.registry import plugins
from stlbench.registry.choices import Choice
from stlbench.registry.folders import task_of
from stlbench.report import condense, only
from stlbench.rollout.standards import differences
from stlbench.study.cell import Cell
from stlbench.study.plugin_guard import ask
from stlbench.study.progress import Progress, Tally, duration
from stlbench.study.run import build_executor, missing_cells, run_cells, run_missing
from stlbench.study.solve import parse_settings, plan_alignment
from stlbench.study.study import Study
from stlbench.task import load_task

DEFAULTS = {"tasks": "reach-stay", "methods": "funnel,flag"}  # what is compared where neither options nor a file say


@study_options(tasks=("", DEFAULTS["tasks"]), methods=("", DEFAULTS["methods"]))
def run(
    study: Annotated[
        Path | None,
        typer.Argument(metavar="[STUDY]", help="A YAML file with these options as its keys; options go before it."),
    ] = None,
    *,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would run, and how long, and stop.")] = False,
    explain: Explain = False,
    verbose: Verbose = False,
    **options: Any,
) -> None:
    """Compare reward methods: train and score every task, method, agent and seed.

    Each cell is recorded in DIR as it ends. The same command again runs only what is missing and repeats the tables,
    so an interrupted run goes on. The exit code is 1 if a cell raised, timed out or was killed, 2 for bad input or if
    every cell is unsuitable, 74 if the disk is full, 130 after ctrl-C, otherwise 0.

    \b
    Examples:
      stlbench run --tasks reach-stay --methods funnel,flag --seeds 3 --jobs 2
      stlbench run --methods "funnel,funnel[variant=code],flag[beta=10]" --budget paper --results study
      stlbench run study.yaml --seeds 10
    """
    described = Study.of(options, study) if study else Study.of(DEFAULTS | options)
    if dry_run:
        typer.echo(_what_would_run(described))
        return
    with interruptible(described.cells, described.folder), Progress(verbose) as progress:
        cells = run_missing(described, progress)
    report_cells({cell.id for cell in cells}, described.folder, explain)


def _what_would_run(study: Study) -> str:
    """The cells that are missing, and how long they take if each takes as long as those of its setting did."""
    cells = study.cells()  # planned once, as that takes long
    missing, before = missing_cells(study, cells)
    if not missing:
        return f"nothing would run: all {len(cells)} cells have a result"
    tally = Tally([cell.id for cell in missing])
    for result in before:
        tally.add(result)
    jobs = build_executor(study.executor, study.jobs, study.memory).jobs
    first = f"{len(missing)} of {len(cells)} cells would run, {jobs} at a time"
    seconds = tally.expected() / jobs
    return f"{first}, for about {duration(seconds)}" if seconds else f"{first}; nobody knows for how long"


@contextmanager
def interruptible(cells: Callable[[], Sequence[Cell]], folder: Path) -> Iterator[None]:
    """Where someone interrupts what runs these cells, or the disk is full, say how many of them are recorded, and exit
    with code 130 or `DISK_FULL`."""
    try:
        yield
    except KeyboardInterrupt:
        typer.echo(f"interrupted: {_recorded(cells(), folder)}; run the same command again to continue", err=True)
        raise typer.Exit(130) from None
    except DiskFull as error:
        refuse(f"{error}: {_recorded(cells(), folder)}; make room, and run the same command again to continue")
        raise typer.Exit(DISK_FULL) from None


def _recorded(cells: Sequence[Cell], folder: Path) -> str:
    with Ledger(folder / FILE) as ledger:
        count = len(ledger.finished(cell.key for cell in cells))
    return f"{count} of {len(cells)} cells are recorded in {folder}/"


def report_cells(cells: Container[CellId], folder: Path, explain: bool) -> None:
    """Write the tables of all cells in the folder and show those of some; exit with code 1 if one had an accident.

    Raises:
        UsageError: all of these cells ended as unsuitable.
    """
    recorded = condense(stored.read(folder), stored.missing(folder).values())
    shown = only(recorded, cells)
    rows = [row for group in shown for row in group.rows]
    show_report(recorded, folder, explain, shown=shown)
    if any(row.status in ACCIDENTS for row in rows):
        raise typer.Exit(1)
    if rows and all(row.status == "unsuitable" for row in rows):
        reasons = list(dict.fromkeys(row.reason for row in rows))
        others = f"; other cells have other reasons ({len(reasons) - 1})" if len(reasons) > 1 else ""
        raise UsageError(f"no cell fits, so nothing was trained: {rows[0].id.name}: {reasons[0]}{others}")


_RESULTS = "results/plan"


@study_options("methods", "jobs", "results", "executor", "retry", methods=("", "all that fit"), results=("", _RESULTS))
def plan(
    task: TaskName,
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
    verbose: Verbose = False,
    **options: Any,
) -> None:
    """Say what the rewards of a task ask for: plan for them, and for the formula itself, without training.

    For each method and setting, the policy that is best by the reward is computed on a grid of the state and scored as
    any policy is. The table Alignment compares it with the best known. On a coarse grid (--resolution 0.6) a cell
    takes 2 to 30 seconds for a method without memory. The same command again runs only what is missing.

    \b
    Examples:
      stlbench plan overlap --methods raw,funnel --resolution 0.6
      stlbench plan reach-stay --settings "recipe,gamma=1,without=cuts gamma=1"
    """
    chosen, results = choices(options.get("methods")), Path(options.get("results", _RESULTS))
    cells = plan_alignment(task_of(task), chosen, None if settings is None else parse_settings(settings), resolution)
    executor, retry = build_executor(options.get("executor", "local"), options.get("jobs")), options.get("retry")
    with interruptible(lambda: cells, results), Progress(verbose) as progress:
        run_cells(cells, results, executor, retry=accidents_of(retry), progress=progress)
    _say_equal([cell.id for cell in cells], chosen)
    report_cells({cell.id for cell in cells}, results, explain)


def _say_equal(cells: Sequence[CellId], methods: Sequence[Choice] | None) -> None:
    """Which of the methods pay for the same on the task, and on those of its ablations that reward another form."""
    seen = set[object]()
    for task in dict.fromkeys(cell.task for cell in cells):
        loaded = load_task(task)
        if loaded.specification.formula not in seen:
            seen.add(loaded.specification.formula)
            for difference in differences(task, plugins.available("methods") if methods is None else methods, ask):
                typer.echo(f"{task}: {difference}")
