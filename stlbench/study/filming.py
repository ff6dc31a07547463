"""The film of one cell, or its pictures: what was recorded, or the stored policy that acts again."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple

from stlbench.contract import GymTask
from stlbench.contract.presentation import Banded
from stlbench.errors import UsageError
from stlbench.records.result import MAIN, Result
from stlbench.records.saved_policies import Which
from stlbench.report.figures.files import file_name, save
from stlbench.report.figures.margins import robustness_in_time
from stlbench.report.figures.trajectories import trajectories
from stlbench.rollout.traces import load
from stlbench.study import film
from stlbench.study.policies import EVERY, Replay, Start, reenact, replay
from stlbench.task import load_task

Form = Literal["gif", "webp", "mp4", "png"]


class Filmed(NamedTuple):
    paths: tuple[Path, ...]
    remarks: tuple[str, ...]  # a line for each surprise


def film_cell(run: Path, result: Result, which: Which, start: Start, form: Form, out: Path) -> Filmed:
    """Write pictures or a film of a finished cell's policy into the folder `out`.

    Raises `UsageError` if there is nothing to film, or the files cannot be written.
    """
    options: list[str] = [] if which == "selected" else [which]
    if start.point is not None:
        options.append("start-" + ",".join(repr(number).removesuffix(".0") for number in start.point))
    elif start.index is not None:
        options.append(f"start-{start.index}")
    title = ", ".join([result.id.name, *options]).replace("start-", "start ")
    name = file_name(*result.id.name.split("/"), result.id.budget, *options)
    if form == "png":
        return Filmed(tuple(_pictures(replay(run, result, which, start), title, out, name)), ())
    recorded = which == "selected" and start == EVERY
    shown = _recorded(run, result) if recorded else replay(run, result, which, start)
    acted, remarks, states = None, list[str](), shown.recording.film
    if isinstance(shown.task.dynamics, GymTask) and states is not None:
        try:
            acted = reenact(run, result, which, start, states)
        except UsageError as error:
            remarks.append(f"no pictures of the environment: {error}")
    path = out / f"film-{name}.{form}"
    remark = film.write(shown.task, shown.recording, shown.robustness, title, path, acted)
    if remark:
        remarks.append(remark)
    elif acted and states and not acted.repeats(shown.recording.traces[states.starts]):
        remarks.append("the pictures differ from what was recorded: the environment did not repeat it")
    return Filmed((path,), tuple(remarks))


def _recorded(run: Path, result: Result) -> Replay:
    """What was recorded when the cell was trained, which needs no policy."""
    assert result.measurement is not None
    task = load_task(result.id.task)
    return Replay(task, None, load(task, result, run), result.measurement.selected[MAIN].robustness)


def _pictures(shown: Replay, title: str, out: Path, name: str) -> Iterator[Path]:
    bands = shown.method.band() if isinstance(shown.method, Banded) else ()
    yield from save(trajectories(shown.task, shown.recording, title), out, f"trajectories-{name}")
    if figure := robustness_in_time(shown.task, shown.recording, bands, title):
        yield from save(figure, out, f"time-{name}")
