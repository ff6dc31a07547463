"""The figure of alignment, read back from matplotlib's own objects."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg

from stlbench.report.figures.across import alignment
from stlbench.report.figures.files import drawings_of_alignment
from stlbench.report.figures.style import fitting
from stlbench.report.tables.yardsticks import Aligned
from stlbench.task import load_task

ROWS = (
    Aligned("overlap", "funnel", "recipe", 0.235, 0.119, selected=0.12, final=0.1),
    Aligned("overlap", "raw", "recipe", 0.235, -0.127, selected=0.059, final=0.04),
    Aligned("overlap", "raw", "gamma=1", 0.235, -30.0),
    Aligned("pendulum", "raw", "gamma=1", None, -2.37),
)
UNITS = {"overlap": "m", "pendulum": "rad"}


def marks(axes, marker):
    """(robustness, place) of all marks of a kind."""
    return [
        (float(line.get_xdata()[0]), int(line.get_ydata()[0])) for line in axes.lines if line.get_marker() == marker
    ]


def test_a_panel_for_each_task_and_a_row_for_each_method_and_setting():
    first, second = alignment(ROWS, UNITS).axes
    assert (first.get_title(), second.get_title()) == ("overlap", "pendulum")
    labels = [[label.get_text() for label in axes.get_yticklabels()] for axes in (first, second)]
    assert labels == [["funnel, recipe", "raw, recipe", "raw, gamma=1"], ["raw, gamma=1"]]
    assert marks(first, "D") == [(0.119, 0), (-0.127, 1)]
    assert marks(first, "o") == [(0.12, 0), (0.059, 1)]
    assert marks(first, "x") == [(0.1, 0), (0.04, 1)]
    assert (marks(second, "D"), marks(second, "o")) == ([(-2.37, 0)], [])
    assert first.get_xlabel() == "mean robustness [m]"


def test_the_best_known_is_a_line_across_the_row_where_it_is_known():
    first, second = alignment(ROWS, UNITS).axes
    best = [[line for line in axes.lines if line.get_linewidth() == 2] for axes in (first, second)]
    assert [tuple(line.get_ydata()) for line in best[0]] == [(-0.5, 0.5), (0.5, 1.5), (1.5, 2.5)]
    assert {tuple(line.get_xdata()) for line in best[0]} == {(0.235, 0.235)}
    assert best[1] == []


def test_what_is_far_below_does_not_press_the_rest_together():
    figure = alignment(ROWS, UNITS)
    axes, _ = figure.axes
    pixels = axes.transData.transform([(value, 0) for value in (-0.127, 0.119, 0.235)])[:, 0]
    shares = np.diff(pixels) / (axes.bbox.x1 - axes.bbox.x0)
    assert (shares > 0.2).all()
    assert [(text.get_text(), text.xy[1]) for text in axes.texts] == [("-30", 2)]
    assert [line.get_ydata()[0] for line in axes.lines if line.get_marker() == "<"] == [2]
    assert "below the axis: numbers in the colour of the mark" in [
        text.get_text() for text in figure.legends[0].get_texts()
    ]


def test_title_and_legend_have_room_in_one_column():
    with fitting("column"):
        figure = alignment(ROWS[:2], UNITS)
    FigureCanvasAgg(figure).draw()
    (axes,), (legend,) = figure.axes, figure.legends
    assert axes.get_tightbbox().y0 >= legend.get_window_extent().y1
    assert axes.get_tightbbox().y1 <= figure._suptitle.get_window_extent().y0


def test_without_a_planned_policy_there_is_no_figure(tmp_path: Path):
    assert _write([Aligned("overlap", "(formula)", "recipe", 0.2)], tmp_path) == []


def _write(rows, folder):
    return [path for each in drawings_of_alignment(rows, load_task) for path in each.write(folder)]
