"""The paper's figures: the page shows each picture that the script draws, and what is drawn is what was recorded."""

from __future__ import annotations

import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from helpers.studies import load

from stlbench.simulation.referee import Recording
from stlbench.task import load_task

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "reproduction.md"


@pytest.fixture(scope="module")
def study() -> ModuleType:
    return load("paper_figures")


def test_the_page_shows_every_picture(study: ModuleType) -> None:
    names = {picture.name for picture in study.PICTURES}
    assert set(re.findall(r"\(figures/paper/(.*)\.png\)", PAGE.read_text(encoding="utf-8"))) == names
    assert {path.stem for path in (ROOT / "docs" / "figures" / "paper").glob("*.png")} == names


def test_the_script_trains_what_is_drawn(study: ModuleType) -> None:
    text = (ROOT / "studies" / "reproduce" / "paper-figures.sh").read_text(encoding="utf-8")
    runs = re.findall(r"^train --tasks (\S+) --methods (\S+)", text, re.MULTILINE)
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
