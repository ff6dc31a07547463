"""No text is cut off, and no legend covers data, in any kind of figure."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.synthetic_results import result
from matplotlib.axis import Tick
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from stlbench.report import condense
from stlbench.report.figures.margins import robustness_in_time
from stlbench.report.figures.methods import learning_curves, overview, robustness_by_method
from stlbench.report.figures.regions import Scale
from stlbench.report.figures.style import colours_of
from stlbench.report.figures.trajectories import trajectories
from stlbench.simulation.referee import Recording
from stlbench.task import build_method, load_task

METHODS = ("flag", "funnel[variant=code,ginf=0.02]", "raw", "tau-mdp")
GROUPS = condense(
    [
        result(method, seed, task="formation", robustness=(value * (1 + seed / 10),))
        for method, value in zip(METHODS, (-100.0, 0.02, 0.01, -3.0), strict=True)
        for seed in range(2)
    ]
)


def recording(task):
    """Traces that swing through all values, also through some beyond the range of the signals."""
    t = np.linspace(0, 6, task.file.steps + 1)
    low, high = np.array(task.specification.low), np.array(task.specification.high)
    phases = np.arange(4)[:, None, None]
    traces = (low + high) / 2 + 0.6 * (high - low) * np.sin(t[:, None] + phases + np.arange(len(low)))
    return Recording(traces, seeds=1)


def in_time(name, *, rewarded=False):
    task = load_task(name)
    bands = build_method(task, "funnel").band()
    return robustness_in_time(task, recording(task), bands, f"{name}, funnel (dqn, quick)", rewarded=rewarded)


def in_plane(name):
    task = load_task(name)
    return trajectories(task, recording(task), f"{name}, funnel[variant=code,ginf=0.02] (dqn-per-robot, quick)")


def at_a_glance(name):
    task = load_task(name)
    return overview(task, GROUPS, [recording(task).traces] * len(GROUPS), colours_of(GROUPS))


FIGURES = {
    "robustness": lambda: robustness_by_method(GROUPS, Scale("m or rad or rad/s", math.inf), colours_of(GROUPS)),
    "rewarded-formation": lambda: in_time("formation", rewarded=True),
    "overview-robot-nav": lambda: at_a_glance("robot-nav"),
    "learning": lambda: learning_curves(GROUPS, Scale("m or rad or rad/s", math.inf), colours_of(GROUPS)),
    **{f"time-{name}": lambda name=name: in_time(name) for name in ("formation", "pendulum")},
    **{f"trajectories-{name}": lambda name=name: in_plane(name) for name in ("formation", "overlap")},
}


def texts(figure):
    """All texts of a figure that are drawn, but those on axes' ticks, which have their own room or are left out."""
    ticks = {text for tick in figure.findobj(Tick) for text in tick.findobj(Text)}
    return [text for text in figure.findobj(Text) if text.get_text() and text.get_visible() and text not in ticks]


NIGHTLY = ("rewarded-formation", "time-pendulum", "trajectories-overlap")
"""Others show the same kind of figure."""


@pytest.mark.parametrize("kind", [pytest.param(kind, marks=[pytest.mark.slow] * (kind in NIGHTLY)) for kind in FIGURES])
def test_all_text_is_in_the_picture_and_the_legend_beside_the_axes(kind):
    figure = FIGURES[kind]()
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    width, height = figure.bbox.size
    for text in texts(figure):
        (left, bottom), (right, top) = text.get_window_extent(renderer).get_points()
        assert min(left, bottom) >= -1, f"{text} is cut off"
        assert right <= width + 1, f"{text} is cut off"
        assert top <= height + 1, f"{text} is cut off"
    (legend,) = figure.legends
    frame = legend.get_window_extent(renderer)
    for axes in figure.axes:
        assert not frame.overlaps(axes.get_tightbbox(renderer)), f"{axes} is under the legend"
    titles = [axes.title.get_window_extent(renderer) for axes in figure.axes if axes.get_title()]
    assert not any(a.overlaps(b) for i, a in enumerate(titles) for b in titles[:i])
