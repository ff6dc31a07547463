"""Still pictures of one cell: what its policy did, in the plane or against time, and the robustness in time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from stlbench.contract import RewardMethod
from stlbench.contract.presentation import Band, Banded
from stlbench.report.figures.files import save
from stlbench.report.figures.margins import robustness_in_time
from stlbench.report.figures.trajectories import trajectories
from stlbench.rollout.traces import Recording
from stlbench.task.task import Task


def draw_cell(
    task: Task, method: RewardMethod | None, recording: Recording, title: str, folder: Path, name: str
) -> list[Path]:
    """Write `trajectories-NAME` and, where the formula has terms, `time-NAME`; the files' paths."""
    bands: Sequence[Band] = method.band() if isinstance(method, Banded) else ()
    figures = {
        "trajectories": trajectories(task, recording, title),
        "time": robustness_in_time(task, recording, bands, title),
    }
    return [
        path
        for kind, figure in figures.items()
        if figure is not None
        for path in save(figure, folder, f"{kind}-{name}")
    ]
