"""`stlbench render`: a film of one cell, or still pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from stlbench.cli.common import warn
from stlbench.cli.options import Budget, Cell, Folder, TaskFolders, Which
from stlbench.errors import UsageError


def render(
    run: Folder,
    cell: Cell,
    budget: Budget = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of the files.", show_default="RESULTS/films")
    ] = None,
    form: Annotated[
        Literal["gif", "webp", "mp4", "png"],
        typer.Option("--format", help="webp is small; mp4 needs ffmpeg; png: still pictures, as vectors too."),
    ] = "gif",
    which: Which = "selected",
    start: Annotated[
        str | None, typer.Option(metavar="X,Y,...", help="Where the stored policy starts, as the task's initial box.")
    ] = None,
    start_index: Annotated[
        int | None, typer.Option(metavar="I", min=0, help="Which of the report's starts, counted from 0.")
    ] = None,
    task_folders: TaskFolders = None,
) -> None:
    """Film one cell: the best and the worst start of its report, side by side; or any one start of its stored policy.

    Systems and environments that draw themselves are shown so; of others, the plane that the task names, or the signals
    against time. With --start, --start-index, --policy final or --format png, and before an environment's camera, the
    stored policy acts again.

    \b
    Examples:
      stlbench render results reach-stay/funnel/dqn/0
      stlbench render results reach-stay/funnel/dqn/0 --start 0.3,1.2
      stlbench render results "robot-nav/funnel[variant=code]/dqn/0" --format mp4 --out films
    """
    from stlbench.records.outputs import inside
    from stlbench.report.film import check_format
    from stlbench.rollout.questions import Question, plugins_of
    from stlbench.study.filming import film_cell
    from stlbench.study.plugin_guard import ask_one
    from stlbench.study.policies import Start, parse_start
    from stlbench.study.results import Results

    if start is not None and start_index is not None:
        raise UsageError("--start and --start-index: one start, said once")
    if form != "png":
        check_format(form)
    chosen = Start(start_index, None if start is None else parse_start(start))
    result = Results.load(run).cell(cell, budget)
    if result.measurement is None:
        reason = f": {result.reason}" if result.reason else ""
        raise UsageError(f"{result.id.name} has no policy to film: {result.status}{reason}")
    arguments = (run, result, which, chosen, form, out or inside(run / "films", run))
    filmed = ask_one(Question(film_cell, arguments, plugins_of(result.id), f"{result.id.name} cannot be filmed"))
    for remark in filmed.remarks:
        warn(remark)
    for path in filmed.paths:
        typer.echo(path)
