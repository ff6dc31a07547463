"""`stlbench render`: a film of one cell."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from stlbench.cli.common import LEDGER, warn
from stlbench.errors import UsageError, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stlbench.result import Result


def render(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A folder that `stlbench run` wrote.")],
    cell: Annotated[str, typer.Argument(metavar="CELL", help="task/method/agent/seed, as the run's lines name it.")],
    budget: Annotated[
        str | None, typer.Option(metavar="NAME", help="Budget of the cell.", show_default="the only one in RUN")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of the film.", show_default="RUN/films")
    ] = None,
    form: Annotated[Literal["gif", "mp4"], typer.Option("--format", help="mp4 needs ffmpeg.")] = "gif",
) -> None:
    """Film one cell: the best and the worst start of its report, side by side.

    Systems that draw themselves are shown so; of others, the plane that the task names, or the signals against time.

    \b
    Examples:
      stlbench render results hold-disc/funnel/dqn/0
      stlbench render results "robot-nav/funnel[variant=code]/dqn/0" --format mp4 --out films
    """
    from stlbench.report.figures.drawing import file_name
    from stlbench.report.film import film, video
    from stlbench.result import MAIN
    from stlbench.rollout.traces import load
    from stlbench.study.ledger import Ledger
    from stlbench.task import load_task

    video.check_format(form)
    with Ledger(run / LEDGER, create=False) as ledger:
        result = _only(list(ledger.results()), cell, budget, run)
    if result.measurement is None:
        reason = f": {result.reason}" if result.reason else ""
        raise UsageError(f"{cell} has no policy to film: {result.status}{reason}")
    task = load_task(result.task)
    recording = load(task, result, run)
    name = file_name("film", *result.name.split("/"), result.budget)
    path = (out or run / "films") / f"{name}.{form}"
    try:
        remark = film.write(task, recording, result.measurement.selected[MAIN].robustness, result.name, path)
    except OSError as error:
        raise UsageError(f"cannot write the film: {error}") from error
    if remark:
        warn(remark)
    typer.echo(path)


def _only(results: Sequence[Result], cell: str, budget: str | None, run: Path) -> Result:
    """The one result of that name and budget."""
    found = {result.budget: result for result in results if result.name == cell}
    if not found:
        raise UsageError(f"{run} has no cell '{cell}'{did_you_mean(cell, {result.name for result in results})}")
    if budget is not None and budget not in found:
        raise UsageError(f"{cell} has no budget '{budget}' in {run}{did_you_mean(budget, found)}")
    if budget is None and len(found) > 1:
        raise UsageError(f"{cell} is in {run} with the budgets {', '.join(sorted(found))}; say which by --budget")
    return found[budget] if budget is not None else next(iter(found.values()))
