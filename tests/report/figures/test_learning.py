"""Learning curves, read back from matplotlib's own objects."""

from __future__ import annotations

import math

import pytest
from helpers.synthetic_results import result

from stlbench.records.result import CurvePoint
from stlbench.report import condense
from stlbench.report.figures.layout import LEVEL
from stlbench.report.figures.methods import learning_curves
from stlbench.report.figures.regions import Scale
from stlbench.report.figures.style import colours_of
from stlbench.statistics.intervals import mean_interval


def curve(*points):
    return tuple(CurvePoint(steps, 0.0, satisfaction, robustness, 64) for steps, satisfaction, robustness in points)


GROUPS = condense(
    [
        result("flag", 0, curve=curve((100, 0.5, 0.1), (200, 0.5, 0.1))),
        result("flag", 1, "timeout"),
        result("funnel", 0, curve=curve((100, 0.0, -1.0), (200, 1.0, 0.5))),
        result("funnel", 1, curve=curve((100, 0.2, 0.0), (200, 0.6, 0.4))),
        result("tau-mdp", 0, "intractable", reason="too many"),
        result("tau-mdp", 1, "intractable", reason="too many"),
    ]
)


def lines(axes):
    return {line.get_color(): line for line in axes.lines if len(line.get_xdata()) and line.get_color() != LEVEL}


@pytest.fixture(scope="module")
def figure():
    return learning_curves(GROUPS, Scale("m", math.inf), colours_of(GROUPS))


def test_a_line_is_the_mean_over_seeds_and_the_legend_says_how_many_and_how_they_ended(figure):
    flag, funnel = lines(figure.axes[0]).values()
    assert list(funnel.get_xdata()) == [100, 200]
    assert list(funnel.get_ydata()) == pytest.approx([10, 80])
    assert list(flag.get_ydata()) == pytest.approx([50, 50])
    _, funnel = lines(figure.axes[1]).values()
    assert list(funnel.get_ydata()) == pytest.approx([-0.5, 0.45])
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "flag: 1 of 2 seeds, 1 timeout",
        "funnel: 2 of 2 seeds",
        "tau-mdp: intractable",
        "95 % interval of the mean, cut at what is possible",
        "robustness 0: satisfied above",
    ]


def test_the_interval_is_cut_at_what_is_possible_and_by_axes_with_room_for_all_seeds_and_one_seed_has_none(figure):
    left, right = figure.axes
    (band,) = left.collections
    corners = band.get_paths()[0].vertices
    for steps, values in ((100, [0.0, 20.0]), (200, [60.0, 100.0])):
        ends = [y for x, y in corners if x == steps]
        low, high = mean_interval(values)
        assert (low, high) != (max(low, 0), min(high, 100))
        assert (min(ends), max(ends)) == pytest.approx((max(low, 0), min(high, 100)))
    assert left.get_ylim() == (-4, 104)
    assert right.get_ylim() == pytest.approx((-1 - 0.075, 0.5 + 0.075))


def test_agent_and_budget_are_named_where_they_differ():
    groups = condense([result(agent="dqn"), result(agent="sb3-dqn"), result(agent="dqn", budget="paper")])
    (legend,) = learning_curves(groups, Scale("m", math.inf), colours_of(groups)).legends
    assert [text.get_text().partition(":")[0] for text in legend.get_texts()[:3]] == [
        "funnel, dqn, paper",
        "funnel, dqn, quick",
        "funnel, sb3-dqn, quick",
    ]


def test_a_single_checkpoint_is_a_point():
    groups = condense([result(curve=curve((100, 1.0, 0.1)))])
    left, _ = learning_curves(groups, Scale("m", math.inf), colours_of(groups)).axes
    (line,) = lines(left).values()
    assert line.get_marker() == "o"
