"""Robustness by method, read back from matplotlib's own objects."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.synthetic_results import result

from stlbench.report import condense
from stlbench.report.figures.learning import learning_curves
from stlbench.report.figures.robustness import robustness_by_method
from stlbench.result import CurvePoint


def curve(*points):
    return tuple(CurvePoint(steps, 0.0, satisfaction, robustness) for steps, satisfaction, robustness in points)


GROUPS = condense(
    [
        result("funnel", 0, robustness=(0.1,), curve=curve((100, 0.0, -1.0), (200, 1.0, 0.5))),
        result("funnel", 1, robustness=(0.3,), curve=curve((100, 0.2, 0.0), (200, 0.6, 0.3))),
        result("flag", 0, robustness=(-0.2,), curve=curve((100, 0.5, 0.1), (200, 0.5, 0.1))),
        result("tau-mdp", 0, "intractable", reason="too many"),
    ]
)


def test_every_seed_is_a_point_and_the_iqm_stands_under_it():
    (axes,) = robustness_by_method(GROUPS, "m").axes
    drawn = [sorted(map(float, line.get_xdata())) for line in axes.lines]
    assert [-0.2] in drawn
    assert [0.1, 0.3] in drawn
    assert [pytest.approx(0.2)] in drawn


def test_a_method_without_a_result_keeps_its_place():
    (axes,) = robustness_by_method(GROUPS, "m").axes
    labels = [label.get_text() for label in axes.get_yticklabels()]
    assert labels == ["flag\n1 of 1 seeds", "funnel\n2 of 2 seeds", "tau-mdp\nintractable"]
    assert [(text.get_text(), text.get_position()[1]) for text in axes.texts] == [("no result", 2)]


def test_a_method_has_one_colour_in_both_figures():
    points = {line.get_color() for line in robustness_by_method(GROUPS, "m").axes[0].lines if line.get_marker() == "D"}
    curves = [line.get_color() for line in learning_curves(GROUPS, "m").axes[0].lines]
    assert len(set(curves)) == 2
    assert set(curves) == points


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


def test_methods_near_zero_are_told_apart_beside_one_at_minus_100():
    (axes,) = robustness_by_method(pendulum(), "rad or rad/s").axes
    assert axes.get_xlabel() == "mean robustness over the report starts [rad or rad/s]\nlogarithmic beyond ±0.1"
    assert axes.xaxis.get_transform().linthresh == 0.1
    assert [label.get_text() for label in axes.get_xticklabels()] == ["-100", "-10", "-1", "-0.1", "0", "0.1"]
    points = {line.get_ydata()[0]: line.get_xdata() for line in axes.lines if line.get_marker() == "o"}
    _, funnel, raw = (sorted(points[place - 0.12]) for place in range(3))
    low, high = axes.get_xlim()
    transform = axes.xaxis.get_transform().transform
    width = np.diff(transform([low, high])).item()
    assert (transform(funnel[-1]) - transform(raw[0])) / width > 0.04  # .030 and .004, of -102 to .1
    assert (transform(funnel[1]) - transform(funnel[0])) / width > 0.1  # .022 and -.074
    assert low < min(map(min, points.values()))


def test_values_of_one_size_have_a_linear_axis_in_the_unit_that_is_given():
    (axes,) = robustness_by_method(GROUPS, "m").axes
    assert axes.get_xscale() == "linear"
    assert axes.get_xlabel() == "mean robustness over the report starts [m]"


def test_intervals_have_room_unless_they_would_squeeze_the_points():
    """Of three seeds all of it; of two seeds, 12.7 standard errors to either side, no more than what is shown."""
    three = condense(result("raw", seed, robustness=(value,)) for seed, value in enumerate((0.3, 0.4, 0.5)))
    low, high = robustness_by_method(three, "m").axes[0].get_xlim()
    margin = 0.05 * (0.4 + 0.2484)
    assert (low, high) == pytest.approx((-margin, 0.6484 + margin), abs=1e-3)
    two = condense(result("raw", seed, robustness=(value,)) for seed, value in enumerate((0.1, 0.9)))
    low, high = robustness_by_method(two, "m").axes[0].get_xlim()
    assert (low, high) == pytest.approx((-0.9 - 0.135, 1.8 + 0.135))


def test_learning_curves_of_methods_near_zero_are_told_apart():
    rising = {
        "funnel": (-10.0, -0.1, 0.02, 0.03),
        "raw": (-130.0, -2.0, 0.01, 0.013),
        "flag": (-700.0, -200, -150, -160),
    }
    groups = pendulum(
        **{name: curve(*((100 * i, 0.0, value) for i, value in enumerate(values))) for name, values in rising.items()}
    )
    _, right = learning_curves(groups, "rad").axes
    assert right.get_ylabel() == "mean robustness [rad]\nlogarithmic beyond ±0.1"
    low, high = right.get_ylim()
    assert low < -700
    assert high > 0.03
