"""Robustness by method, read back from matplotlib's own objects."""

from __future__ import annotations

import math

import pytest
from helpers.synthetic_results import result

from stlbench.records.result import CurvePoint
from stlbench.report import condense
from stlbench.report.figures.methods import learning_curves, robustness_by_method
from stlbench.report.figures.regions import Scale
from stlbench.report.figures.style import colours_of


def curve(*points):
    return tuple(CurvePoint(steps, 0.0, satisfaction, robustness, 64) for steps, satisfaction, robustness in points)


GROUPS = condense(
    [
        result("funnel", 0, robustness=(0.1,), curve=curve((100, 0.0, -1.0), (200, 1.0, 0.5))),
        result("funnel", 1, robustness=(0.3,), curve=curve((100, 0.2, 0.0), (200, 0.6, 0.3))),
        result("flag", 0, robustness=(-0.2,), curve=curve((100, 0.5, 0.1), (200, 0.5, 0.1))),
        result("tau-mdp", 0, "intractable", reason="too many"),
    ]
)


def test_every_seed_is_a_point_in_the_colour_of_its_method_and_the_median_stands_under_it():
    colours = colours_of(GROUPS)
    (axes,) = robustness_by_method(GROUPS, Scale("m", math.inf), colours).axes
    drawn = [sorted(map(float, line.get_xdata())) for line in axes.lines]
    assert [-0.2] in drawn
    assert [0.1, 0.3] in drawn
    assert [pytest.approx(0.2)] in drawn
    for marker in "oD":
        rows = {round(line.get_ydata()[0]): line.get_color() for line in axes.lines if line.get_marker() == marker}
        assert rows == {row: colours[str(GROUPS[row].setting.method)] for row in (0, 1)}
    labels = [label.get_text() for label in axes.get_yticklabels()]
    assert labels == ["flag\n1 of 1 seeds", "funnel\n2 of 2 seeds", "tau-mdp\nintractable"]
    assert [(text.get_text(), text.get_position()[1]) for text in axes.texts] == [("no result", 2)]


PENDULUM = {
    "flag": (-34.5, -54.6, -29.5, -35.7, -101.9),
    "funnel": (-0.0742, 0.0217, 0.0300, 0.0228, 0.0290),
    "raw": (0.0043, 0.0133, 0.0196, 0.0099, 0.0208),
}
"""Mean robustness of five seeds on the pendulum, as a reference study once had them."""


def pendulum(**curves):
    """Those results, with checkpoints where given."""
    return condense(
        result(method, seed, task="pendulum", robustness=(value,), curve=curves.get(method, ()))
        for method, values in PENDULUM.items()
        for seed, value in enumerate(values)
    )


def test_methods_near_zero_are_told_apart_and_what_lies_beyond_the_axis_is_an_arrow_with_its_numbers():
    figure = robustness_by_method(pendulum(), Scale("rad or rad/s", math.inf), colours_of(pendulum()))
    (axes,) = figure.axes
    assert axes.get_xlabel() == "mean robustness over the report starts [rad or rad/s]"
    assert axes.get_xscale() == "linear"
    low, high = axes.get_xlim()
    points = {line.get_ydata()[0]: line.get_xdata() for line in axes.lines if line.get_marker() == "o"}
    funnel, raw = (sorted(points[place - 0.14]) for place in (1, 2))
    assert (funnel[-1] - raw[0]) / (high - low) > 0.2  # .030 and .004
    assert low < funnel[0] == -0.0742
    assert len(points) == 2
    told = {text.get_text(): text.xy[1] for text in axes.texts}
    assert told == {"5 seeds, -29.5 to -102": -0.14, "median -35.7 [-102, -29.5]": 0.2}
    arrows = [line for line in axes.lines if line.get_marker() == "<"]
    assert [(line.get_xdata()[0], line.get_ydata()[0]) for line in arrows] == [(0.0, -0.14), (0.0, 0.2)]
    assert "beyond the axis" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_the_axis_has_all_seeds_and_no_interval_goes_beyond_them():
    values = (0.3, 0.4, 0.5, -0.3, 0.45)
    five = condense(result("raw", seed, robustness=(value,)) for seed, value in enumerate(values))
    (axes,) = robustness_by_method(five, Scale("m", math.inf), colours_of(five)).axes
    assert axes.get_xlim() == pytest.approx((-0.34, 0.54))
    assert [-0.3, 0.5] in [[*map(float, line.get_xdata())] for line in axes.lines if line.get_linewidth() == 2]


def test_learning_curves_of_methods_near_zero_are_told_apart():
    rising = {
        "funnel": (-10.0, -0.1, 0.02, 0.03),
        "raw": (-130.0, -2.0, 0.01, 0.013),
        "flag": (-700.0, -200, -150, -160),
    }
    groups = pendulum(
        **{name: curve(*((100 * i, 0.0, value) for i, value in enumerate(values))) for name, values in rising.items()}
    )
    _, right = learning_curves(groups, Scale("rad", math.inf), colours_of(groups)).axes
    assert right.get_ylabel() == "mean robustness [rad]"
    low, high = right.get_ylim()
    assert -0.1 < low < 0
    assert high > 0.03
    assert [text.get_text() for text in right.texts] == ["-160"]
