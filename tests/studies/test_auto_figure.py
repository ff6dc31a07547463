"""The figure of the track auto: one row per task and method of the reference, on one scale."""

from __future__ import annotations

import pytest
from helpers.studies import load

from stlbench.task import load_task

figure = load("auto_figure")


def test_every_task_of_the_reference_has_a_row_for_each_method() -> None:
    (axes,) = figure.draw().axes
    assert len(axes.get_yticks()) == 12 * len(figure.SHOWN)
    assert len(axes.texts) == 12 * len(figure.SHOWN)


def test_the_scale() -> None:
    file = load_task("reach-stay").file
    assert figure.recorded.scored("reach-stay", file.best_known.robustness) == pytest.approx(1)
    assert figure.recorded.scored("reach-stay", file.baselines.random.robustness) == pytest.approx(0)
