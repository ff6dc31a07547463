"""`stlbench render`: a film of one cell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from stlbench.cli.common import warn
from stlbench.errors import UsageError


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
    from stlbench.report.figures.files import file_name
    from stlbench.report.film import film, video
    from stlbench.result import MAIN
    from stlbench.rollout.traces import load
    from stlbench.study.results import Results
    from stlbench.task import load_task

    video.check_format(form)
    result = Results.load(run).cell(cell, budget)
    name = result.id.name
    if result.measurement is None:
        reason = f": {result.reason}" if result.reason else ""
        raise UsageError(f"{name} has no policy to film: {result.status}{reason}")
    task = load_task(result.id.task)
    recording = load(task, result, run)
    path = (out or run / "films") / f"{file_name('film', *name.split('/'), result.id.budget)}.{form}"
    try:
        remark = film.write(task, recording, result.measurement.selected[MAIN].robustness, name, path)
    except OSError as error:
        raise UsageError(f"cannot write the film: {error}") from error
    if remark:
        warn(remark)
    typer.echo(path)
