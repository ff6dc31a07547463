"""Trajectories in the plane and signals against time, read back from matplotlib's own objects."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.line_task import line
from matplotlib.collections import LineCollection
from matplotlib.patches import Rectangle

from stlbench.errors import UsageError
from stlbench.report.figures.regions import region
from stlbench.report.figures.style import TRACE, term_style
from stlbench.report.figures.trajectories import Plan, planned, trajectories
from stlbench.simulation.referee import Recording
from stlbench.task import load_task

GRID = np.linspace(0, 4, 81)


def spiral(count):
    """Traces of hold-disc that circle the disc's centre, sample t at radius t / 200."""
    t = np.linspace(0, 1, 201)
    angles = 6 * t + np.linspace(0, 6, count)[:, None]
    return Recording(np.stack([2 + t * np.cos(angles), 2 + t * np.sin(angles)], axis=-1), seeds=1)


class TestRegion:
    def test_the_disc(self):
        task = load_task("hold-disc")
        (term,) = task.specification.terms
        margin, truth = region(task, term.psi, (GRID, GRID), ("x", "y")) or pytest.fail("no region")
        expected = 1 - np.hypot(GRID[:, None] - 2, GRID - 2)
        assert margin == pytest.approx(expected)
        assert truth[expected > 1e-9].all()
        assert not truth[expected < -1e-9].any()

    def test_axes_in_another_order_than_the_signals(self):
        task = line(
            signals={"x": {"low": 0, "high": 4}, "y": {"low": 0, "high": 2}}, formula="G[0,4] x <= 1", plane=["y", "x"]
        )
        (term,) = task.specification.terms
        grid = (np.array([0.0, 2.0]), np.array([0.0, 1.0, 3.0]))
        margin, _ = region(task, term.psi, grid, ("y", "x")) or pytest.fail("no region")
        assert margin.tolist() == [[1, 0, -2], [1, 0, -2]]

    def test_a_signal_that_is_left_out_takes_its_best_value(self):
        task = line(
            signals={"x": {"low": 0, "high": 4}, "y": {"low": 0, "high": 2}}, formula="G[0,4] (x <= 1 & y >= 1.5)"
        )
        (term,) = task.specification.terms
        margin, truth = region(task, term.psi, (np.array([0.0, 0.7, 2.0]),), ("x",)) or pytest.fail("no region")
        assert margin == pytest.approx([0.5, 0.3, -1])
        assert truth.tolist() == [True, True, False]

    def test_signals_that_psi_does_not_read_do_not_matter_and_too_many_leave_no_region(self):
        signals = {name: {"low": 0, "high": 1} for name in "abcdef"}
        terms = line(
            signals=signals,
            formula="G[0,1] a >= 0.25 & G[0,1] a + b + c + d + e >= 4 & G[0,1] a + b + c + d + e + f >= 5",
        )
        few, five, six = terms.specification.terms
        grid = (np.array([0.0, 1.0]),)
        assert region(terms, few.psi, grid, ("b",)) is None
        found = region(terms, few.psi, grid, ("a",))
        assert found is not None
        assert found[0].tolist() == [-0.25, 0.75]
        found = region(terms, five.psi, grid, ("a",))
        assert found is not None
        assert found[0].tolist() == [0, 1]
        assert region(terms, six.psi, grid, ("a",)) is None


@pytest.mark.parametrize(
    ("plane", "message"),
    [
        (["x", "z"], "plane: no signal 'z'; there are: x, y"),
        (["x", "x"], "plane: two different signals are needed, got 'x' twice"),
        (["x"], "plane"),
        (["x", "y", "x"], "plane"),
    ],
)
def test_a_plane_is_two_signals(plane, message):
    with pytest.raises(UsageError, match=message):
        line(signals={"x": {"low": 0, "high": 4}, "y": {"low": 0, "high": 2}}, plane=plane)


class TestPlane:
    figure = trajectories(load_task("hold-disc"), spiral(20), "hold-disc, funnel")
    axes = figure.axes[0]

    def test_sixteen_traces_coloured_by_time(self):
        (lines,) = [entry for entry in self.axes.collections if isinstance(entry, LineCollection)]
        segments = np.array(lines.get_segments()).reshape(16, -1, 2, 2)
        assert segments[0, 0, 0].tolist() == [2, 2]
        assert segments[0, -1, 1] == pytest.approx([2 + np.cos(6), 2 + np.sin(6)])
        assert np.linalg.norm(segments[:, -1, 1] - 2, axis=1) == pytest.approx(np.ones(16))
        times = np.asarray(lines.get_array()).reshape(16, -1)
        radii = np.linalg.norm(segments[:, :, 0] - 2, axis=-1)
        assert times / 200 == pytest.approx(radii)
        assert lines.get_clim() == (0, 200)

    def test_starts_and_ends_are_marked(self):
        start, end = self.axes.lines
        assert set(zip(start.get_xdata(), start.get_ydata(), strict=True)) == {(2.0, 2.0)}
        assert np.hypot(end.get_xdata() - 2, end.get_ydata() - 2) == pytest.approx(np.ones(16))

    def test_the_region_is_the_disc_and_the_picture_shows_it_and_the_traces(self):
        contour = [entry for entry in self.axes.collections if not isinstance(entry, LineCollection)][-1]
        vertices = np.concatenate([path.vertices for path in contour.get_paths()])
        assert np.hypot(*(vertices - 2).T) == pytest.approx(np.ones(len(vertices)), abs=0.002)
        assert (self.axes.get_xlabel(), self.axes.get_ylabel()) == ("x [m]", "y [m]")
        assert self.axes.get_aspect() == 1
        assert self.figure.axes[1].get_ylabel() == "time [steps of 0.01 s]"
        for low, high in (self.axes.get_xlim(), self.axes.get_ylim()):
            assert 0.8 < low < 1 < 3 < high < 3.2
        texts = [text.get_text() for text in self.figure.legends[0].get_texts()]
        assert texts == ["G[0,200] norm(x - 2, y - 2) <= 1", "start", "end"]


LEAVES = [[0, 1, 9, 12, 12, 9, 1, 0, 0], [0] * 9]
"""x of two traces; the range of the signals is [-10, 10], so the first is out of the picture for two samples."""
PLANE = {name: {"low": -10, "high": 10, "unit": "m"} for name in "xy"}


def test_a_trace_that_is_clipped_is_marked_where_it_leaves_and_counted():
    x = np.array(LEAVES, dtype=float)
    task = line(signals=PLANE, plane=["x", "y"], formula="G[0,4] x <= 1")
    figure = trajectories(task, Recording(np.stack([x, x / 2], axis=-1), seeds=1), "line")
    (mark,) = [entry for entry in figure.axes[0].lines if entry.get_marker() == "X"]
    assert (list(mark.get_xdata()), list(mark.get_ydata())) == ([10], [6])
    assert "leaves the picture here: 1 of 2 traces" in [text.get_text() for text in figure.legends[0].get_texts()]
    assert figure.axes[0].get_xlim()[1] == 10


def test_after_an_early_end_a_trace_ends_in_the_plane_where_it_was_last_recorded():
    x = np.array([[0, 1, 2, 3, 4, 5, 6, 7, 8], [0, -1, -2, *[np.nan] * 6]])
    task = line(signals=PLANE, plane=["x", "y"], formula="G[0,4] x <= 1", terminated="violated")
    figure = trajectories(task, Recording(np.stack([x, x / 2], axis=-1), seeds=1), "line")
    (mark,) = [entry for entry in figure.axes[0].lines if entry.get_marker() == "s"]
    assert mark.get_xydata().tolist() == [[8, 4], [-2, -1]]
    low, high = figure.axes[0].get_xlim()
    assert low < -2
    assert high > 8


def test_signals_against_time_are_never_clipped():
    task = line()
    (axes,) = trajectories(task, Recording(np.array(LEAVES, dtype=float)[..., None] * 5, seeds=1), "line").axes
    assert axes.get_ylim()[1] >= 60
    assert axes.get_xlim() == (0, 8)


def colours_of(figure):
    """Of the boxes of regions: what has no region has an empty one."""
    boxes = [box for box in figure.legends[0].get_patches() if box.get_facecolor()[3] and box.get_linewidth()]
    return [tuple(box.get_edgecolor()) for box in boxes]


def test_no_two_terms_of_a_legend_look_alike_and_one_without_a_region_is_empty():
    task = load_task("formation")
    traces = np.zeros((2, task.file.steps + 1, len(task.signals)))
    figure = trajectories(task, Recording(traces, seeds=1), "formation")
    colours = colours_of(figure)
    assert len(set(colours)) == len(colours) == 3
    first, *others = [text.get_text() for text in figure.legends[0].get_texts()]
    assert first.startswith("G[0,130]")
    assert first.endswith("(has no region here)")
    assert others[:3] == [
        "G[40,50] norm(ax - 4, ay - 3.5) <= 0.5",
        "G[80,90] norm(bx - 4, by - 2.25) <= 0.5",
        "G[120,130] norm(cx - 4, cy - 1) <= 0.5",
    ]
    assert all(entry.get_color() == TRACE for axes in figure.axes for entry in axes.lines)


def test_terms_beyond_the_palette_are_hatched():
    formula = " & ".join(f"G[{i},{i}] x <= {i}" for i in range(7))
    figure = trajectories(line(formula=formula), Recording(np.zeros((1, 9, 1)), seeds=1), "line")
    patches = [handle for handle in figure.legends[0].get_patches() if handle.get_linewidth()]
    looks = [(tuple(handle.get_edgecolor()), handle.get_hatch()) for handle in patches]
    assert len(set(looks)) == 7
    regions = [entry for entry in figure.axes[0].patches if tuple(entry.get_edgecolor()) == looks[6][0]]
    assert {entry.get_hatch() or "" for entry in regions} == {"", term_style(6).hatch}


def test_regions_are_of_the_tasks_own_formula():
    figure = trajectories(
        line(formula="G[0,4] x <= 1", rewarded="G[0,4] 2 * x <= 2"), Recording(np.zeros((1, 9, 1)), seeds=1), "line"
    )
    assert figure.legends[0].get_texts()[0].get_text() == "G[0,4] x <= 1"


class TestSignals:
    task = line(formula="G[5,7] (abs(x) >= 4 & abs(x) <= 6)", starts=4)
    recording = Recording(np.arange(27.0).reshape(3, 9, 1), seeds=1)

    def test_each_trace_is_a_line(self):
        (axes,) = trajectories(self.task, self.recording, "line").axes
        assert [list(entry.get_ydata()) for entry in axes.lines] == [list(range(9 * i, 9 * i + 9)) for i in range(3)]
        assert axes.get_ylabel() == "x [m]"
        assert axes.get_xlabel() == "time [steps of 0.5 s]"

    def test_where_a_term_can_hold_is_a_rectangle_a_run(self):
        (axes,) = trajectories(self.task, self.recording, "line").axes
        shaded, low, high = [entry for entry in axes.patches if isinstance(entry, Rectangle)]
        assert (shaded.get_x(), shaded.get_width()) == (5, 2)
        assert [low.get_x(), low.get_y(), low.get_width(), low.get_height()] == pytest.approx([5, -6, 2, 2], abs=0.03)
        assert [high.get_x(), high.get_y(), high.get_width(), high.get_height()] == pytest.approx(
            [5, 4, 2, 2], abs=0.03
        )

    def test_a_formula_outside_the_fragment_is_shown_by_its_parts(self):
        task = line(signals={"x": {"low": 0, "high": 4}}, formula="G[0,2] (F[0,2] x <= 1 | G[1,2] x >= 3)")
        (axes,) = trajectories(task, self.recording, "line").axes
        boxes = [entry for entry in axes.patches if isinstance(entry, Rectangle)][1::2]  # after the shaded steps
        found = [(each.get_x(), each.get_width(), each.get_y(), each.get_height()) for each in boxes]
        assert found == [pytest.approx((0, 4, 0, 1), abs=0.01), pytest.approx((1, 3, 3, 1), abs=0.01)]


def straight(end, signals):
    """One trace of a straight way from 0 to an end, in all signals alike."""
    return np.linspace(0, end, 9)[None, :, None] * np.ones(signals)


def test_plans_have_a_panel_each_in_one_view_of_the_plane_or_of_the_signals():
    task = line(signals=PLANE, plane=["x", "y"], formula="G[0,4] x <= 1")
    first, second, _ = planned(task, [Plan("a", 0.25, 1.0, straight(4, 2)), Plan("b", -3.0, 0.5, straight(8, 2))]).axes
    assert first.get_title() == "a\nrobustness 0.25, satisfies from 100 %"
    assert second.get_title() == "b\nrobustness -3, satisfies from 50 %"
    assert first.get_xlim() == second.get_xlim()
    assert second.get_xlim()[1] > 8
    plans = [Plan(name, 0.0, 0.0, straight(end, 1)) for name, end in zip("abcd", (1, 2, 3, 9), strict=True)]
    shown = [axes for axes in planned(line(formula="G[0,4] x <= 1"), plans).axes if axes.get_visible()]
    assert [axes.get_title().partition("\n")[0] for axes in shown] == list("abcd")
    assert len({axes.get_ylim() for axes in shown}) == 1
    assert [max(float(line.get_ydata()[-1]) for line in axes.lines) for axes in shown] == [1, 2, 3, 9]
