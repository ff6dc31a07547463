"""The subjects of the paper's Figures 3 to 12, drawn from our own runs: docs/reproduction.md shows them.

make reproduce TABLE=paper-figures                                    train the cells, one seed each, and draw
python studies/paper_figures.py results/paper         draw from a folder of results, into docs/figures/paper
python studies/paper_figures.py results/paper FOLDER  draw into another folder
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple

from matplotlib.figure import Figure

from stlbench import Results
from stlbench.contract.presentation import Band, Banded
from stlbench.records.result import Result
from stlbench.report.figures.files import save
from stlbench.report.figures.margins import robustness_in_time
from stlbench.report.figures.trajectories import trajectories
from stlbench.simulation.referee import Recording, gather, load
from stlbench.study.policies import Start, replay
from stlbench.task import build_method, load_task
from stlbench.task.task import Task

FOLDER = Path(__file__).parents[1] / "docs" / "figures" / "paper"
ANYWHERE = tuple(range(0, 51, 5))
"""Starts of the integrator in Figure 5. Some lie between the two regions, from where the formula cannot hold."""

Kind = Literal["robustness", "rewarded", "trajectories", "anywhere"]


class Picture(NamedTuple):
    """One panel of one of the paper's figures."""

    figure: int
    """Its number, as in docs/reproduction.md."""
    task: str
    method: str
    kind: Kind
    """Robustness against time, in the form that methods see too; trajectories, from the report's starts or anywhere."""

    @property
    def name(self) -> str:
        """The name of its files, without an ending."""
        return f"figure-{self.figure}-{self.task}-{self.method}-{self.kind}"


PICTURES = (
    Picture(3, "pendulum", "funnel", "rewarded"),
    Picture(3, "pendulum", "funnel", "trajectories"),
    Picture(4, "robot-nav", "funnel", "robustness"),
    Picture(4, "robot-nav", "funnel", "trajectories"),
    Picture(4, "robot-nav", "raw", "trajectories"),
    Picture(5, "integrator-or", "funnel", "anywhere"),
    Picture(6, "annulus", "funnel", "robustness"),
    Picture(6, "annulus", "funnel", "trajectories"),
    Picture(7, "hold-disc-coarse", "flag", "trajectories"),
    Picture(7, "hold-disc-coarse", "funnel", "trajectories"),
    Picture(9, "overlap", "funnel", "rewarded"),
    Picture(9, "overlap", "funnel", "trajectories"),
    Picture(10, "fetch-reach", "funnel", "robustness"),
    Picture(11, "cartpole", "funnel", "rewarded"),
    Picture(12, "ball-in-cup", "funnel", "robustness"),
)


def draw(picture: Picture, task: Task, recording: Recording) -> Figure:
    """The figure of what was recorded."""
    title = f"{picture.task}, {picture.method}"
    if picture.kind in ("trajectories", "anywhere"):
        return trajectories(task, recording, title)
    figure = robustness_in_time(task, recording, bands(task, picture), title, rewarded=picture.kind == "rewarded")
    assert figure is not None, f"the formula of {picture.task} is made of terms"
    return figure


def bands(task: Task, picture: Picture) -> Sequence[Band]:
    """The funnels, where the method has any."""
    method = build_method(task, picture.method)
    return method.band() if isinstance(method, Banded) else ()


def recorded(picture: Picture, task: Task, result: Result, run: Path) -> Recording:
    """The traces of the run's report; or what the stored policy does now, from places of the figure's own."""
    if picture.kind != "anywhere":
        return load(task, result, run)
    played = [replay(run, result, "selected", Start(None, (float(place),))) for place in ANYWHERE]
    return gather([each.recording for each in played])


def main(words: list[str]) -> None:
    """Draw every picture; raises `UsageError` where the folder lacks a cell."""
    run, folder = Path(words[0]), Path(words[1]) if len(words) > 1 else FOLDER
    results = Results.load(run)
    for picture in PICTURES:
        task = load_task(picture.task)
        agent = {"fetch-reach": "td3", "cartpole": "td3", "ball-in-cup": "td3"}.get(picture.task, "dqn")
        result = results.cell(f"{picture.task}/{picture.method}/{agent}/0")
        for path in save(draw(picture, task, recorded(picture, task, result, run)), folder, picture.name):
            print(path)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        raise SystemExit("name a folder of results: python studies/paper_figures.py results/paper")
    main(sys.argv[1:])
