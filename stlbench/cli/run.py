"""`stlbench run`: plan the cells, run those that are missing, show the tables."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from stlbench.cli.common import LEDGER
from stlbench.cli.report import show_report
from stlbench.errors import UsageError

if TYPE_CHECKING:
    from stlbench.contract import Executor
    from stlbench.study.ledger import Ledger
    from stlbench.study.matrix import Cell

MOST_SEEDS = 10_000


def run(
    tasks: Annotated[str, typer.Option(metavar="LIST", help="Tasks, a comma list.")] = "hold-disc",
    methods: Annotated[
        str, typer.Option(metavar="LIST", help="Reward methods, a comma list; parameters in brackets.")
    ] = "funnel,flag",
    agents: Annotated[
        str | None,
        typer.Option(
            metavar="LIST",
            help="Agents, a comma list; parameters override the task's recipe.",
            show_default="each task's own",
        ),
    ] = None,
    seeds: Annotated[
        str | None,
        typer.Option(
            metavar="SEEDS",
            help="A number N means seeds 0..N-1; '0-4' or '3,7' names them.",
            show_default="as the budget says",
        ),
    ] = None,
    budget: Annotated[
        str, typer.Option(metavar="NAME", help="How much training; `stlbench show task NAME` lists budgets.")
    ] = "quick",
    jobs: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Cells at a time.", show_default="2, or 1 on a single core")
    ] = None,
    results: Annotated[Path, typer.Option(metavar="DIR", help="Folder of ledger, traces, tables.")] = Path("results"),
    executor: Annotated[str, typer.Option(metavar="NAME", help="Where cells run.")] = "local",
    retry: Annotated[
        bool, typer.Option("--retry", help="Run cells again that raised, timed out or were killed.")
    ] = False,
) -> None:
    """Compare reward methods: train and score every task, method, agent and seed.

    Each cell is recorded in DIR as it ends. The same command again runs only what is missing and repeats the tables,
    so an interrupted run goes on. The exit code is 1 if a cell raised, timed out or was killed, 2 for bad input, 130
    after ctrl-C, otherwise 0.

    \b
    Examples:
      stlbench run --tasks hold-disc --methods funnel,flag --seeds 3 --jobs 2
      stlbench run --methods "funnel,funnel[variant=code],flag[beta=10]" --budget paper --results study
    """
    from stlbench.report import condense
    from stlbench.result import ACCIDENTS
    from stlbench.study import matrix
    from stlbench.study.ledger import Ledger

    cells = plan(tasks, methods, agents, seeds, budget)
    place = build_executor(executor, jobs or min(2, os.cpu_count() or 1))
    with Ledger(results / LEDGER) as ledger:
        done = ledger.finished((cell.key for cell in cells), retry)
        matrix.check(cell for cell in cells if cell.key not in done)
        try:
            run_missing(cells, len(done), ledger, place, retry, results)
        except KeyboardInterrupt:
            count = len(ledger.finished(cell.key for cell in cells))
            recorded = f"{count} of {len(cells)} cells are recorded in {results}/"
            typer.echo(f"interrupted: {recorded}; say the same command again to go on", err=True)
            raise typer.Exit(130) from None
        groups = condense(ledger.results({cell.key for cell in cells}))
    show_report(groups, results)
    if any(row.status in ACCIDENTS for group in groups for row in group.rows):
        raise typer.Exit(1)


def plan(tasks: str, methods: str, agents: str | None, seeds: str | None, budget: str) -> tuple[Cell, ...]:
    """The cells that the options name."""
    from stlbench.registry.choices import parse_choices
    from stlbench.study import matrix

    wanted = None if seeds is None else parse_seeds(seeds)
    trained = None if agents is None else parse_choices(agents)
    return matrix.plan([*map(str, parse_choices(tasks))], parse_choices(methods), trained, wanted, budget)


def parse_seeds(text: str) -> tuple[int, ...]:
    """A lone number is a count, "3" -> 0, 1, 2; with a comma or a dash it is a list, "0-2,7" -> 0, 1, 2, 7. Sorted."""
    if re.fullmatch(r"\s*[0-9]{1,5}\s*", text):
        ranges = [(0, int(text) - 1)]
    else:
        ranges = [_seed_range(item, text) for item in text.split(",")]
    if any(first > last or last >= MOST_SEEDS for first, last in ranges):
        raise UsageError(f"--seeds {text}: at least one seed, each less than {MOST_SEEDS}, ranges from low to high")
    return tuple(sorted({seed for first, last in ranges for seed in range(first, last + 1)}))


def _seed_range(item: str, text: str) -> tuple[int, int]:
    ends = re.fullmatch(r"\s*([0-9]{1,5})(?:-([0-9]{1,5}))?\s*", item)
    if not ends:
        raise UsageError(f"--seeds {text}: expected a count, as in 3, or a list of seeds, as in 3,7 or 0-4")
    return int(ends[1]), int(ends[2] or ends[1])


def build_executor(text: str, jobs: int) -> Executor:
    """The executor that the options name."""
    from stlbench.registry import plugins
    from stlbench.registry.choices import parse_choice

    return cast("Executor", plugins.build("executors", parse_choice(text), defaults={"jobs": jobs}))


def run_missing(
    cells: Sequence[Cell], done: int, ledger: Ledger, executor: Executor, retry: bool, folder: Path
) -> None:
    """Run the cells without a result, and say how each ended."""
    from stlbench.cli.progress import Progress
    from stlbench.study import scheduler, trial
    from stlbench.study.provenance import collect
    from stlbench.task import load_task

    limits = {name: load_task(name) for name in {cell.task for cell in cells}}
    deadlines = [limits[cell.task].budget(cell.budget).deadline for cell in cells]
    function = partial(trial.run_cell, folder=folder / "traces")
    results = scheduler.run(cells, ledger, executor, function, deadlines, collect(executor.jobs), retry)
    with Progress(len(cells), done) as progress, closing(results):
        for result in results:
            progress.ended(result)
