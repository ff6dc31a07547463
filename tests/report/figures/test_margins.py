"""Robustness against time, read back from matplotlib's own objects; margins worked out by hand on a line."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.line_task import line
from matplotlib.axes import Axes

from stlbench.presentation import Band
from stlbench.report.figures.margins import FUNNEL, TRACE, robustness_in_time
from stlbench.rollout.traces import Recording

TWO = "F[1,3] x >= 2 & G[5,7] x <= 1"


def recording(*rows):
    """Traces of one signal, nine samples each."""
    return Recording(np.array(rows, dtype=float)[..., None], seeds=1)


ZEROS, TWOS, FOURS = [0] * 9, [2] * 9, [4] * 9


def drawn(axes: Axes, colour: str) -> list[list[float]]:
    return [list(entry.get_ydata()) for entry in axes.lines if entry.get_color() == colour]


def figure(formula=TWO, rows=(ZEROS, TWOS, FOURS), bands=(), **changes):
    return robustness_in_time(line(formula=formula, **changes), recording(*rows), bands, "line, raw")


def test_a_row_a_term_with_its_formula_and_the_median_margin():
    first, second = figure().axes
    assert first.get_title(loc="left") == "F[1,3] x >= 2"
    assert second.get_title(loc="left") == "G[5,7] x <= 1"
    assert drawn(first, TRACE) == [[0.0] * 9]
    assert drawn(second, TRACE) == [[-1.0] * 9]


def test_the_middle_90_percent_are_shaded():
    rows = [[value] * 9 for value in range(101)]
    (first,) = figure("G[0,4] x <= 50", rows, signals={"x": {"low": -200, "high": 200}}).axes
    box = first.collections[0].get_paths()[0].get_extents()
    assert (box.y0, box.y1) == pytest.approx((50 - 95, 50 - 5))
    assert (box.x0, box.x1) == (0, 8)


def test_single_traces_go_from_the_worst_to_the_best_in_the_terms_interval():
    late = [0, 0, 0, 0, 0, 0, 0, 0, 100]  # bad in the last sample alone, which G[0,4] does not read
    rows = [late, *([value] * 9 for value in range(19))]
    (axes,) = figure("G[0,4] x <= 9.5", rows).axes
    firsts = [margins[0] for margins in drawn(axes, "0.35")]
    assert firsts == sorted(firsts)
    assert len(firsts) == 7
    assert (firsts[0], firsts[-1]) == (-8.5, 9.5)


def test_of_always_the_least_margin_is_what_counts_and_of_eventually_the_largest():
    still, swinging = [3] * 9, [0, 9] * 4 + [0]
    for formula, worst in (("G[0,4] x >= 1", swinging), ("F[0,4] x >= 1", still)):
        (axes,) = figure(formula, [still, swinging]).axes
        assert [value + 1 for value in drawn(axes, "0.35")[0]] == worst


def test_the_steps_that_a_term_reads_are_shaded_and_level_zero_is_drawn():
    for axes, ends in zip(figure().axes, [(1, 3), (5, 7)], strict=True):
        (shaded,) = axes.patches
        assert (shaded.get_x(), shaded.get_x() + shaded.get_width()) == ends
        assert drawn(axes, "0.25") == [[0, 0]]
    (axes,) = figure("F[1,2] G[3,5] x <= 1").axes
    (shaded,) = axes.patches
    assert (shaded.get_x(), shaded.get_x() + shaded.get_width()) == (4, 7)


def test_the_bounds_of_a_method_are_in_the_row_of_their_term():
    _, term = line(formula=TWO).specification.terms
    found = figure(bands=[Band(term, 4, np.array([-3.0, -1, 0, 0.5]), np.ones(4))])
    first, second = found.axes
    assert drawn(first, FUNNEL) == []
    assert drawn(second, FUNNEL) == [[-3, -1, 0, 0.5], [1, 1, 1, 1]]
    assert [list(entry.get_xdata()) for entry in second.lines if entry.get_color() == FUNNEL] == 2 * [[4, 5, 6, 7]]
    labels = [text.get_text() for text in found.legends[0].get_texts()]
    assert labels[-1] == "the method's bounds"
    assert "the method's bounds" not in [text.get_text() for text in figure().legends[0].get_texts()]


def test_terms_are_those_that_methods_are_told():
    (axes,) = figure("G[0,4] x <= 1", rewarded="G[0,4] 2 * x <= 2").axes
    assert axes.get_title(loc="left") == "G[0,4] 2 * x <= 2"
    assert drawn(axes, TRACE) == [[2.0 - 4.0] * 9]


def test_a_range_that_is_long_below_zero_is_logarithmic_there():
    (axes,) = figure("G[0,4] x <= 9.9", signals={"x": {"low": 9, "high": 1000}}).axes  # rho in [-990.1, 0.9]
    assert axes.get_yscale() == "symlog"
    assert axes.get_ylim()[0] < -990.1
    ticks = [label.get_text() for label in axes.get_yticklabels()]
    assert ticks[-3:] == ["-0.9", "0", "0.9"]
    assert figure().axes[0].get_yscale() == "linear"


def test_a_formula_that_is_not_made_of_terms_has_no_figure():
    assert figure("G[0,2] F[0,2] x <= 1") is None


def test_one_start():
    (axes,) = figure("G[0,4] x <= 1", [ZEROS]).axes
    assert drawn(axes, TRACE) == drawn(axes, "0.35") == [[1.0] * 9]
