"""`stlbench run`: plan the cells, run those that are missing, show the tables."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stlbench.cli.completion import names
from stlbench.cli.options import Executor, Jobs, plan
from stlbench.cli.report import show_report


def run(
    tasks: Annotated[
        str, typer.Option(metavar="LIST", help="Tasks, a comma list.", autocompletion=names("tasks"))
    ] = "hold-disc",
    methods: Annotated[
        str,
        typer.Option(
            metavar="LIST",
            help="Reward methods, a comma list; parameters in brackets.",
            autocompletion=names("methods"),
        ),
    ] = "funnel,flag",
    agents: Annotated[
        str | None,
        typer.Option(
            metavar="LIST",
            help="Agents, a comma list; parameters override the task's recipe.",
            show_default="each task's own",
            autocompletion=names("agents"),
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
    jobs: Jobs = None,
    results: Annotated[Path, typer.Option(metavar="DIR", help="Folder of ledger, traces, tables.")] = Path("results"),
    executor: Executor = "local",
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
    from stlbench.cli.progress import Progress
    from stlbench.report import condense, only
    from stlbench.result import ACCIDENTS
    from stlbench.study.ledger import FILE, Ledger
    from stlbench.study.run import build_executor, run_study

    cells = plan(tasks, methods, agents, seeds, budget)
    try:
        with Progress() as progress:
            run_study(cells, results, build_executor(executor, jobs), retry=retry, progress=progress)
    except KeyboardInterrupt:
        with Ledger(results / FILE) as ledger:
            recorded = (
                f"{len(ledger.finished(cell.key for cell in cells))} of {len(cells)} cells are recorded in {results}/"
            )
        typer.echo(f"interrupted: {recorded}; say the same command again to go on", err=True)
        raise typer.Exit(130) from None
    with Ledger(results / FILE, create=False) as ledger:
        recorded_groups = condense(ledger.results(), ledger.missing())
    groups = only(recorded_groups, {cell.id for cell in cells})
    show_report(groups, recorded_groups, results)
    if any(row.status in ACCIDENTS for group in groups for row in group.rows):
        raise typer.Exit(1)
