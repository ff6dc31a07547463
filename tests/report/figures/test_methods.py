"""Robustness by method, learning curves and a task at a glance, read back from matplotlib's own objects."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.line_task import line
from helpers.synthetic_results import result

from stlbench.records.result import CurvePoint
from stlbench.report import condense
from stlbench.report.figures.layout import LEVEL
from stlbench.report.figures.methods import learning_curves, overview, robustness_by_method
from stlbench.report.figures.regions import Scale
from stlbench.report.figures.style import colours_of
from stlbench.statistics.intervals import mean_interval

METRES = Scale("m", math.inf)


def curve(*points):
    return tuple(CurvePoint(steps, 0.0, satisfaction, robustness, 64) for steps, satisfaction, robustness in points)


GROUPS = condense(
    [
        result("flag", 0, robustness=(-0.2,), curve=curve((100, 0.5, 0.1), (200, 0.5, 0.1))),
        result("flag", 1, "timeout"),
        result("funnel", 0, robustness=(0.1,), curve=curve((100, 0.0, -1.0), (200, 1.0, 0.5))),
        result("funnel", 1, robustness=(0.3,), curve=curve((100, 0.2, 0.0), (200, 0.6, 0.4))),
        result("tau-mdp", 0, "intractable", reason="too many"),
    ]
)
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


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


class TestRobustness:
    def test_every_seed_is_a_point_in_its_method_s_colour_and_the_median_is_under_it(self):
        colours = colours_of(GROUPS)
        (axes,) = robustness_by_method(GROUPS, METRES, colours).axes
        drawn = [sorted(map(float, line.get_xdata())) for line in axes.lines]
        for values in ([-0.2], [0.1, 0.3], [pytest.approx(0.2)]):
            assert values in drawn
        for marker in "oD":
            rows = {round(line.get_ydata()[0]): line.get_color() for line in axes.lines if line.get_marker() == marker}
            assert rows == {row: colours[str(GROUPS[row].setting.method)] for row in (0, 1)}
        labels = [label.get_text() for label in axes.get_yticklabels()]
        assert labels == ["flag\n1 of 2 seeds, 1 timeout", "funnel\n2 of 2 seeds", "tau-mdp\nintractable"]
        assert [(text.get_text(), text.get_position()[1]) for text in axes.texts] == [("no result", 2)]

    def test_methods_near_zero_are_told_apart_and_what_is_beyond_the_axis_is_an_arrow(self):
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
        assert "beyond the axis" in legend(figure)

    def test_the_axis_has_all_seeds_and_no_interval_goes_beyond_them(self):
        values = (0.3, 0.4, 0.5, -0.3, 0.45)
        five = condense(result("raw", seed, robustness=(value,)) for seed, value in enumerate(values))
        (axes,) = robustness_by_method(five, METRES, colours_of(five)).axes
        assert axes.get_xlim() == pytest.approx((-0.34, 0.54))
        assert [-0.3, 0.5] in [[*map(float, line.get_xdata())] for line in axes.lines if line.get_linewidth() == 2]


def curves(axes):
    return {line.get_color(): line for line in axes.lines if len(line.get_xdata()) and line.get_color() != LEVEL}


class TestLearning:
    def test_a_line_is_the_mean_over_seeds_and_its_interval_is_cut_at_what_is_possible(self):
        """And by axes with room for all seeds; one seed has no interval. The legend says how the seeds ended."""
        figure = learning_curves(GROUPS, METRES, colours_of(GROUPS))
        left, right = figure.axes
        flag, funnel = curves(left).values()
        assert list(funnel.get_xdata()) == [100, 200]
        assert list(funnel.get_ydata()) == pytest.approx([10, 80])
        assert list(flag.get_ydata()) == pytest.approx([50, 50])
        assert list([*curves(right).values()][1].get_ydata()) == pytest.approx([-0.5, 0.45])
        assert legend(figure) == [
            "flag: 1 of 2 seeds, 1 timeout",
            "funnel: 2 of 2 seeds",
            "tau-mdp: intractable",
            "95 % interval of the mean, cut at what is possible",
            "robustness 0: satisfied above",
        ]
        (band,) = left.collections
        corners = band.get_paths()[0].vertices
        for steps, values in ((100, [0.0, 20.0]), (200, [60.0, 100.0])):
            ends = [y for x, y in corners if x == steps]
            low, high = mean_interval(values)
            assert (low, high) != (max(low, 0), min(high, 100))
            assert (min(ends), max(ends)) == pytest.approx((max(low, 0), min(high, 100)))
        assert left.get_ylim() == (-4, 104)
        assert right.get_ylim() == pytest.approx((-1 - 0.075, 0.5 + 0.075))

    def test_agent_and_budget_are_named_where_they_differ_and_one_checkpoint_is_a_point(self):
        once = curve((100, 1.0, 0.1))
        groups = condense([result(), result(agent="sb3-dqn"), result(budget="paper", curve=once)])
        figure = learning_curves(groups, METRES, colours_of(groups))
        assert [text.partition(":")[0] for text in legend(figure)[:3]] == [
            "funnel, dqn, paper",
            "funnel, dqn, quick",
            "funnel, sb3-dqn, quick",
        ]
        assert [line.get_marker() for line in figure.axes[0].lines if len(line.get_xdata()) == 1] == ["o"]

    def test_seeds_without_common_steps_have_no_line_and_the_legend_names_them(self):
        apart = [result("funnel", seed, curve=curve((1000 + 10 * seed, 1.0, 0.1))) for seed in (0, 1)]
        groups = condense([*apart, result("raw")])
        figure = learning_curves(groups, METRES, colours_of(groups))
        assert [len(curves(axes)) for axes in figure.axes] == [1, 1]
        assert legend(figure)[:2] == ["funnel: 2 of 2 seeds", "raw: 1 of 1 seeds"]
        alone = learning_curves(groups[:1], METRES, colours_of(groups))
        assert [len(curves(axes)) for axes in alone.axes] == [0, 0]

    def test_methods_near_zero_are_told_apart(self):
        rising = {
            "funnel": (-10.0, -0.1, 0.02, 0.03),
            "raw": (-130.0, -2.0, 0.01, 0.013),
            "flag": (-700.0, -200, -150, -160),
        }
        points = {name: [(100 * i, 0.0, value) for i, value in enumerate(values)] for name, values in rising.items()}
        groups = pendulum(**{name: curve(*each) for name, each in points.items()})
        _, right = learning_curves(groups, Scale("rad", math.inf), colours_of(groups)).axes
        assert right.get_ylabel() == "mean robustness [rad]"
        low, high = right.get_ylim()
        assert -0.1 < low < 0
        assert high > 0.03
        assert [text.get_text() for text in right.texts] == ["-160"]


def test_a_task_at_a_glance_has_a_row_per_group_and_a_panel_per_group_with_traces():
    """All panels show the same part of the plane; traces that leave it are counted in the panel and in the legend."""
    plane = {name: {"low": -10, "high": 10, "unit": "m"} for name in "xy"}
    task = line(signals=plane, plane=["x", "y"], formula="G[0,4] x <= 1")
    traces = [np.linspace(0, end, 9)[None, :, None] * np.ones(2) for end in (5, 20)]
    groups = condense(
        [result("flag", robustness=(-1.0, 1.0)), result("funnel", robustness=(0.1, 0.3)), result("raw", 0, "timeout")]
    )
    figure = overview(task, groups, [*traces, None], colours_of(groups))
    robustness, flag, funnel, bar = figure.axes
    assert len(robustness.get_yticks()) == 3
    assert robustness.get_xlabel() == "mean robustness over the report starts [m]"
    assert flag.get_title() == "flag\nsatisfies from 50 % of the starts"
    leaves = "\nleaving the picture: 1 of 1 traces"
    assert funnel.get_title() == f"funnel\nsatisfies from 100 % of the starts{leaves}"
    assert "leaves the picture here: 1 of 2 traces" in legend(figure)
    assert bar.get_ylabel() == "time [steps of 0.5 s]"
    assert (flag.get_xlim(), flag.get_ylim()) == (funnel.get_xlim(), funnel.get_ylim())
