"""The film of one cell, or its pictures: what was recorded, or the stored policy that acts again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

from stlbench.contract import GymTask
from stlbench.contract.presentation import Banded
from stlbench.errors import UsageError
from stlbench.records.result import MAIN, Result
from stlbench.records.saved_policies import Which
from stlbench.report import film
from stlbench.report.figures.files import file_name, save
from stlbench.report.figures.margins import robustness_in_time
from stlbench.report.figures.trajectories import trajectories
from stlbench.rollout.reenactment import Reenactment
from stlbench.rollout.traces import load
from stlbench.study.policies import Replay, Start, reenact, replay
from stlbench.task import load_task

Form = Literal["gif", "webp", "mp4", "png"]


class Filmed(NamedTuple):
    paths: tuple[Path, ...]
    remarks: tuple[str, ...]
    """What is not as one would expect, in a line each."""


@dataclass(frozen=True)
class Filming:
    """Pictures or a film of a cell's policy, not made yet."""

    run: Path
    """The folder of results."""
    result: Result
    """Of the cell, with a measurement."""
    which: Which
    start: Start
    form: Form
    out: Path
    """The folder of the files."""

    def write(self) -> Filmed:
        """Write the files. Raises `UsageError` where there is nothing to film, or they cannot be written."""
        recorded = self.which == "selected" and self.start == Start() and self.form != "png"
        shown = self._recorded() if recorded else replay(self.run, self.result, self.which, self.start)
        acted, remarks = (None, list[str]()) if self.form == "png" else self._before_camera(shown)
        if self.form == "png":
            return Filmed(tuple(self._pictures(shown)), ())
        path = self.out / f"film-{self._name}.{self.form}"
        remark = film.write(shown.task, shown.recording, shown.robustness, self._title, path, acted)
        return Filmed((path,), (*remarks, *_remarks(shown, acted, remark)))

    def _pictures(self, shown: Replay) -> Iterator[Path]:
        """Write still pictures: trajectories and, where the formula has terms, robustness against time."""
        bands = shown.method.band() if isinstance(shown.method, Banded) else ()
        figures = {
            "trajectories": trajectories(shown.task, shown.recording, self._title),
            "time": robustness_in_time(shown.task, shown.recording, bands, self._title),
        }
        for kind, figure in figures.items():
            if figure is not None:
                yield from save(figure, self.out, f"{kind}-{self._name}")

    @property
    def _options(self) -> list[str]:
        chosen: list[str] = [] if self.which == "selected" else [self.which]
        if self.start.point is not None:
            return [*chosen, "start-" + ",".join(repr(number).removesuffix(".0") for number in self.start.point)]
        return chosen if self.start.index is None else [*chosen, f"start-{self.start.index}"]

    @property
    def _title(self) -> str:
        return self.result.id.name + ", ".join(["", *self._options]).replace("start-", "start ")

    @property
    def _name(self) -> str:
        return file_name(*self.result.id.name.split("/"), self.result.id.budget, *self._options)

    def _recorded(self) -> Replay:
        """What was recorded when the cell was trained, which needs no policy."""
        assert self.result.measurement is not None
        task = load_task(self.result.id.task)
        recording = load(task, self.result, self.run)
        return Replay(task, None, recording, self.result.measurement.selected[MAIN].robustness)

    def _before_camera(self, shown: Replay) -> tuple[Reenactment | None, list[str]]:
        """The policy, ready to act again in an environment that draws itself; None where it cannot, and why."""
        if not isinstance(shown.task.dynamics, GymTask) or shown.recording.film is None:
            return None, []
        try:
            return reenact(self.run, self.result, self.which, self.start, shown.recording.film), []
        except UsageError as error:
            return None, [f"no pictures of the environment: {error}"]


def _remarks(shown: Replay, acted: Reenactment | None, remark: str) -> list[str]:
    if remark:
        return [remark]
    if acted and shown.recording.film and not acted.repeats(shown.recording.traces[shown.recording.film.starts]):
        return ["the pictures are of another course than was recorded: the environment did not do the same again"]
    return []
