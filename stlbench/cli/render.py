"""`stlbench render`: a film of one cell, or still pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from stlbench.cli.common import warn
from stlbench.errors import UsageError

if TYPE_CHECKING:
    from stlbench.result import Result
    from stlbench.rollout.reenactment import Reenactment
    from stlbench.rollout.saved_policies import Which
    from stlbench.study.replay import Replay, Start


def render(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A folder that `stlbench run` wrote.")],
    cell: Annotated[str, typer.Argument(metavar="CELL", help="task/method/agent/seed, as the run's lines name it.")],
    budget: Annotated[
        str | None, typer.Option(metavar="NAME", help="Budget of the cell.", show_default="the only one in RUN")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of the files.", show_default="RUN/films")
    ] = None,
    form: Annotated[
        Literal["gif", "webp", "mp4", "png"],
        typer.Option("--format", help="webp is small; mp4 needs ffmpeg; png: still pictures, as vectors too."),
    ] = "gif",
    which: Annotated[
        Literal["selected", "final"], typer.Option("--policy", help="Which of the cell's two policies.")
    ] = "selected",
    start: Annotated[
        str | None, typer.Option(metavar="X,Y,...", help="Where the stored policy starts, as the task's initial box.")
    ] = None,
    start_index: Annotated[
        int | None, typer.Option(metavar="I", min=0, help="Which of the report's starts, counted from 0.")
    ] = None,
) -> None:
    """Film one cell: the best and the worst start of its report, side by side; or any one start of its stored policy.

    Systems and environments that draw themselves are shown so; of others, the plane that the task names, or the signals
    against time. With --start, --start-index, --policy final or --format png, and before an environment's camera, the
    stored policy acts again.

    \b
    Examples:
      stlbench render results hold-disc/funnel/dqn/0
      stlbench render results hold-disc/funnel/dqn/0 --start 0.3,1.2
      stlbench render results "robot-nav/funnel[variant=code]/dqn/0" --format mp4 --out films
    """
    from stlbench.report.figures.files import file_name
    from stlbench.report.film import video
    from stlbench.study.replay import Start, parse_start, replay
    from stlbench.study.results import Results

    if start is not None and start_index is not None:
        raise UsageError("--start and --start-index: one start, said once")
    if form != "png":
        video.check_format(form)
    chosen = Start(start_index, None if start is None else parse_start(start))
    result = Results.load(run).cell(cell, budget)
    if result.measurement is None:
        reason = f": {result.reason}" if result.reason else ""
        raise UsageError(f"{result.id.name} has no policy to film: {result.status}{reason}")
    recorded = which == "selected" and chosen == Start() and form != "png"
    shown = _recorded(run, result) if recorded else replay(run, result, which, chosen)
    said: list[str] = [] if which == "selected" else [which]
    said += [f"start-{start or start_index}"] if chosen != Start() else []
    title = result.id.name + ", ".join(["", *said]).replace("start-", "start ")
    name = file_name(*result.id.name.split("/"), result.id.budget, *said)
    acted = None if form == "png" else _before_camera(run, result, which, chosen, shown)
    try:
        for path in _write(shown, acted, title, out or run / "films", name, form):
            typer.echo(path)
    except OSError as error:
        raise UsageError(f"cannot write the film: {error}") from error


def _recorded(run: Path, result: Result) -> Replay:
    """What was recorded when the cell was trained, which needs no policy."""
    from stlbench.result import MAIN
    from stlbench.rollout.traces import load
    from stlbench.study.replay import Replay
    from stlbench.task import load_task

    assert result.measurement is not None
    task = load_task(result.id.task)
    return Replay(task, None, load(task, result, run), result.measurement.selected[MAIN].robustness)


def _before_camera(run: Path, result: Result, which: Which, start: Start, shown: Replay) -> Reenactment | None:
    """The policy, ready to act again in an environment that draws itself; None, with a warning, where it cannot."""
    from stlbench.contract import GymTask
    from stlbench.study.replay import reenact

    if not isinstance(shown.task.dynamics, GymTask) or shown.recording.film is None:
        return None
    try:
        return reenact(run, result, which, start, shown.recording.film)
    except UsageError as error:
        warn(f"no pictures of the environment: {error}")
        return None


def _write(
    shown: Replay,
    acted: Reenactment | None,
    title: str,
    folder: Path,
    name: str,
    form: Literal["gif", "webp", "mp4", "png"],
) -> list[Path]:
    """The film, or the pictures; their paths."""
    from stlbench.report.figures.cell_figures import draw_cell
    from stlbench.report.film import film

    if form == "png":
        return draw_cell(shown.task, shown.method, shown.recording, title, folder, name)
    path = folder / f"film-{name}.{form}"
    remark = film.write(shown.task, shown.recording, shown.robustness, title, path, acted)
    if remark:
        warn(remark)
    elif acted and shown.recording.film and not acted.repeats(shown.recording.traces[shown.recording.film.starts]):
        warn("the pictures are of another course than was recorded: the environment did not do the same again")
    return [path]
