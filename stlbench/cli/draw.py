"""`stlbench plot` and `stlbench render`: figures of a run, and films or still pictures of a cell."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer

from stlbench.cli.common import warn
from stlbench.cli.options import Budget, Cell, Fitting, Folder, Listed, TaskFolders, Which
from stlbench.errors import UsageError, did_you_mean
from stlbench.records import stored
from stlbench.records.outputs import inside
from stlbench.registry.choices import Choice, parse_choices
from stlbench.report import condense
from stlbench.rollout.questions import Question, plugins_of
from stlbench.study.plugin_guard import ask, ask_one, load_guarded
from stlbench.study.policies import Start, parse_start
from stlbench.study.results import Results


def plot(
    run: Folder,
    tasks: Listed = None,
    methods: Listed = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of the figures.", show_default="RESULTS/figures")
    ] = None,
    rewarded: Annotated[
        bool, typer.Option("--rewarded", help="Draw the robustness of the tasks' rewarded form against time, too.")
    ] = False,
    width: Fitting = "page",
    only: Annotated[
        str | None,
        typer.Option(
            metavar="LIST",
            help="Kinds: learning, overview, planned, time, trajectories, rewarded.",
            show_default="all but rewarded",
        ),
    ] = None,
    task_folders: TaskFolders = None,
) -> None:
    """Draw a run: learning curves, robustness against time in its funnel, trajectories, and an overview of each task.

    Each figure is written as PNG, SVG and PDF, over the one of before; the files are printed. --width column makes
    them 3.5 inches wide, with text of 7 to 9 points, for one column of a paper.

    \b
    Examples:
      stlbench plot results
      stlbench plot results --tasks robot-nav --methods "funnel,funnel[variant=code]" --out pictures
    """
    from stlbench.report.figures import trace_figures
    from stlbench.report.figures.style import colours_of, fitting

    groups = condense(stored.read(run), stored.missing(run).values())
    settings = [group.setting for group in groups if group.tried]
    some_tasks = _known(tasks, {setting.task for setting in settings}, "task", run)
    some_methods = _known(methods, {setting.method for setting in settings}, "method", run)
    if not any(setting.task in some_tasks and setting.method in some_methods for setting in settings):
        raise UsageError(f"{run} holds no result of these tasks and methods")
    chosen = (
        result for result in stored.read(run) if result.id.task in some_tasks and result.id.method in some_methods
    )
    figures = out or inside(run / "figures", run)
    colours = colours_of(groups)
    job = trace_figures.Job(
        run, figures, partial(typer.echo, err=True), warn, colours, load_guarded, ask, _kinds(only, rewarded)
    )
    with fitting(width):
        for path in trace_figures.draw(chosen, job):
            typer.echo(path)


def _known(text: str | None, known: set[Choice], kind: str, run: Path) -> set[Choice]:
    if text is None:
        return known
    chosen = set(parse_choices(text))
    for choice in sorted(chosen - known):
        raise UsageError(f"{run} has no {kind} '{choice}'{did_you_mean(str(choice), map(str, known))}")
    return chosen


def _kinds(text: str | None, rewarded: bool) -> Sequence[str]:
    from stlbench.report.figures.trace_figures import KINDS, USUAL

    chosen = list(USUAL) if text is None else [item.strip() for item in text.split(",")]
    for kind in chosen:
        if kind not in KINDS:
            raise UsageError(f"no kind of figure '{kind}'{did_you_mean(kind, KINDS)}")
    return [*chosen, *(["rewarded"] if rewarded else [])]


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
        str | None, typer.Option(metavar="X,Y,...", help="Start of the stored policy, as in the task's initial box.")
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
    from stlbench.study.film import ffmpeg
    from stlbench.study.filming import film_cell

    if start is not None and start_index is not None:
        raise UsageError("give --start or --start-index, not both")
    if form == "mp4":
        ffmpeg()
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
