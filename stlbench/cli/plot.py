"""`stlbench plot`: figures of what a run learned and did."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stlbench.cli.common import LEDGER, warn
from stlbench.errors import UsageError, did_you_mean


def plot(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A folder that `stlbench run` wrote.")],
    tasks: Annotated[
        str | None, typer.Option(metavar="LIST", help="Tasks, a comma list.", show_default="all in RUN")
    ] = None,
    methods: Annotated[
        str | None, typer.Option(metavar="LIST", help="Methods, a comma list.", show_default="all in RUN")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of the figures.", show_default="RUN/figures")
    ] = None,
) -> None:
    """Draw a run: learning curves, robustness against time in its funnel, and trajectories.

    Each figure is written as PNG and SVG, over the one of before; the files are printed.

    \b
    Examples:
      stlbench plot results
      stlbench plot results --tasks robot-nav --methods "funnel,funnel[variant=code]" --out pictures
    """
    from stlbench.report.figures import plots
    from stlbench.study.ledger import Ledger

    with Ledger(run / LEDGER, create=False) as ledger:
        results = list(ledger.results())
    wanted = {"task": _known(tasks, {result.task for result in results}, "task", run)}
    wanted["method"] = _known(methods, {result.method for result in results}, "method", run)
    chosen = [result for result in results if all(getattr(result, key) in names for key, names in wanted.items())]
    if not chosen:
        raise UsageError(f"{run / LEDGER} holds no result of these tasks and methods")
    for path in plots.draw(chosen, run, out or run / "figures", tell=_tell, warn=warn):
        typer.echo(path)


def _known(text: str | None, names: set[str], kind: str, run: Path) -> set[str]:
    """The names that a comma list gives, each of them in the run; all where there is no list."""
    from stlbench.registry.choices import parse_choices

    if text is None:
        return names
    chosen = {str(choice) for choice in parse_choices(text)}
    for name in sorted(chosen - names):
        raise UsageError(f"{run} has no {kind} '{name}'{did_you_mean(name, names)}")
    return chosen


def _tell(line: str) -> None:
    typer.echo(line, err=True)
