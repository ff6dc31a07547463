"""Plans side by side, read back from matplotlib's own objects."""

from __future__ import annotations

import numpy as np
from helpers.line_task import line

from stlbench.report.figures.trajectories import Plan, planned

PLANE = {name: {"low": -10, "high": 10, "unit": "m"} for name in "xy"}


def straight(end, signals):
    """One trace of a straight way from 0 to an end, in all signals alike."""
    return np.linspace(0, end, 9)[None, :, None] * np.ones(signals)


def test_a_panel_per_plan_in_one_view_of_the_plane():
    task = line(signals=PLANE, plane=["x", "y"], formula="G[0,4] x <= 1")
    figure = planned(task, [Plan("a", 0.25, 1.0, straight(4, 2)), Plan("b", -3.0, 0.5, straight(8, 2))])
    first, second, _ = figure.axes
    assert first.get_title() == "a\nrobustness 0.25, satisfies from 100 %"
    assert second.get_title() == "b\nrobustness -3, satisfies from 50 %"
    assert first.get_xlim() == second.get_xlim()
    assert second.get_xlim()[1] > 8


def test_without_a_plane_signals_stand_against_time_with_equal_ranges():
    task = line(formula="G[0,4] x <= 1")
    plans = [Plan(name, 0.0, 0.0, straight(end, 1)) for name, end in zip("abcd", (1, 2, 3, 9), strict=True)]
    shown = [axes for axes in planned(task, plans).axes if axes.get_visible()]
    assert [axes.get_title().partition("\n")[0] for axes in shown] == list("abcd")
    assert len({axes.get_ylim() for axes in shown}) == 1
    drawn = [max(float(line.get_ydata()[-1]) for line in axes.lines) for axes in shown]
    assert drawn == [1, 2, 3, 9]
