"""The paper's figures: the page shows each picture that the script draws, and what is drawn is what was recorded."""

from __future__ import annotations

import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from helpers.studies import load

from stlbench.rollout.traces import Recording
from stlbench.task import load_task

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "figures-of-the-paper.md"


@pytest.fixture(scope="module")
def study() -> ModuleType:
    return load("paper_figures")


def test_the_page_shows_every_picture_under_its_figure(study: ModuleType) -> None:
    parts = re.split(r"^## Figure (\d+): .*$", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    shown = {
        (int(number), name)
        for number, text in zip(parts[1::2], parts[2::2], strict=True)
        for name in re.findall(r"\(figures/paper/(.*)\.png\)", text)
    }
    assert shown == {(picture.figure, picture.name) for picture in study.PICTURES}
    assert [int(number) for number in parts[1::2]] == list(range(3, 13))


def test_every_picture_is_there(study: ModuleType) -> None:
    names = {path.stem for path in (ROOT / "docs" / "figures" / "paper").glob("*.png")}
    assert names == {picture.name for picture in study.PICTURES}


def test_the_makefile_trains_what_is_drawn(study: ModuleType) -> None:
    text = (ROOT / "Makefile").read_text(encoding="utf-8").replace("\\\n", " ")
    runs = re.findall(r"\$\(PAPER\) --tasks (\S+) --methods (\S+)", text)
    trained = {(task, method) for tasks, methods in runs for task in tasks.split(",") for method in methods.split(",")}
    assert trained == {(picture.task, picture.method) for picture in study.PICTURES}


@pytest.mark.parametrize("number", [0, 4])
def test_what_is_drawn_is_what_was_recorded(study: ModuleType, number: int) -> None:
    picture = study.PICTURES[number]
    task = load_task(picture.task)
    trace = np.zeros((2, task.file.steps + 1, len(task.signals)))
    figure = study.draw(picture, task, Recording(trace, 1))
    assert picture.method in figure.get_suptitle()
    if picture.kind == "rewarded":
        assert len(figure.axes) == 3
        assert [line.get_linestyle() for line in figure.axes[0].lines].count("--") == 2  # the funnel
