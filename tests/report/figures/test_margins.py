"""Robustness against time, read back from matplotlib's own objects; margins worked out by hand on a line."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.line_task import line
from matplotlib.axes import Axes

from stlbench.contract.presentation import Band
from stlbench.report.figures.layout import LEVEL
from stlbench.report.figures.margins import BAND_ELSEWHERE, ONE_TRACE, robustness_in_time
from stlbench.report.figures.style import BOUNDS, TRACE
from stlbench.simulation.referee import Recording

TWO = "F[1,3] x >= 2 & G[5,7] x <= 1"


def recording(*rows):
    """Traces of one signal, nine samples each."""
    return Recording(np.array(rows, dtype=float)[..., None], seeds=1)


ZEROS, TWOS, FOURS = [0] * 9, [2] * 9, [4] * 9


def drawn(axes: Axes, colour: str) -> list[list[float]]:
    return [list(entry.get_ydata()) for entry in axes.lines if entry.get_color() == colour]


def figure(formula=TWO, rows=(ZEROS, TWOS, FOURS), bands=(), told=False, **changes):
    return robustness_in_time(line(formula=formula, **changes), recording(*rows), bands, "line, raw", rewarded=told)


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


EARLY = [np.nan] * 3


def test_after_early_ends_the_median_is_of_the_traces_that_go_on():
    rows = [[0] * 6 + EARLY, [2] * 3 + 2 * EARLY, [3] * 6 + EARLY]
    (axes,) = figure("G[0,4] x <= 1", rows, terminated="violated").axes
    assert drawn(axes, TRACE) == [[-1.0] * 3 + [-0.5] * 3]
    assert [list(each.get_xdata()) for each in axes.lines if each.get_color() == TRACE] == [[*range(6)]]
    box = axes.collections[0].get_paths()[0].get_extents()
    assert (box.x0, box.x1) == (0, 5)


def test_an_early_end_is_drawn_as_the_worst_trace_and_its_samples_give_the_range():
    wide = {"x": {"low": 9, "high": 1000}}
    rows = [[9.5] * 9, [9.6, 2000, 9.6] + 2 * EARLY]
    (axes,) = figure("G[0,4] x <= 9.9", rows, signals=wide, terminated="violated").axes
    assert [each[0] for each in drawn(axes, ONE_TRACE)] == pytest.approx([0.3, 0.4])
    assert axes.get_ylim()[0] < -1990.1


def test_single_traces_go_from_the_worst_to_the_best_in_the_terms_interval():
    late = [0, 0, 0, 0, 0, 0, 0, 0, 100]  # bad in the last sample alone, which G[0,4] does not read
    rows = [late, *([value] * 9 for value in range(19))]
    (axes,) = figure("G[0,4] x <= 9.5", rows).axes
    firsts = [margins[0] for margins in drawn(axes, ONE_TRACE)]
    assert firsts == sorted(firsts)
    assert len(firsts) == 7
    assert (firsts[0], firsts[-1]) == (-8.5, 9.5)


def test_of_always_the_least_margin_is_what_counts_and_of_eventually_the_largest():
    still, swinging = [3] * 9, [0, 9] * 4 + [0]
    for formula, worst in (("G[0,4] x >= 1", swinging), ("F[0,4] x >= 1", still)):
        (axes,) = figure(formula, [still, swinging]).axes
        assert [value + 1 for value in drawn(axes, ONE_TRACE)[0]] == worst


def test_the_steps_that_a_term_reads_are_shaded_and_level_zero_is_drawn():
    for axes, ends in zip(figure().axes, [(1, 3), (5, 7)], strict=True):
        (shaded,) = axes.patches
        assert (shaded.get_x(), shaded.get_x() + shaded.get_width()) == ends
        assert drawn(axes, LEVEL) == [[0, 0]]
    (axes,) = figure("F[1,2] G[3,5] x <= 1").axes
    (shaded,) = axes.patches
    assert (shaded.get_x(), shaded.get_x() + shaded.get_width()) == (4, 7)


def test_the_bounds_of_a_method_are_in_the_row_of_their_term():
    _, term = line(formula=TWO).specification.terms
    banded = figure(bands=[Band(term, 4, np.array([-3.0, -1, 0, 0.5]), np.ones(4))])
    first, second = banded.axes
    assert drawn(first, BOUNDS) == []
    assert drawn(second, BOUNDS) == [[-3, -1, 0, 0.5], [1, 1, 1, 1]]
    assert [list(entry.get_xdata()) for entry in second.lines if entry.get_color() == BOUNDS] == 2 * [[4, 5, 6, 7]]
    assert legend(banded)[-1] == "the method's bounds"
    assert "the method's bounds" not in legend(figure())


OWN, REWARDED = "G[0,4] x <= 1", "G[0,4] 2 * x <= 2"


def rewarded_band():
    (term,) = line(formula=OWN, rewarded=REWARDED).specification.terms
    return [Band(term, 0, np.zeros(5), np.ones(5))]


def legend(drawing):
    return [text.get_text() for text in drawing.legends[0].get_texts()]


def test_the_tasks_own_predicate_is_drawn_in_its_unit_and_not_what_methods_are_told():
    (axes,) = figure(OWN, rewarded=REWARDED).axes
    assert axes.get_title(loc="left") == OWN
    assert drawn(axes, TRACE) == [[1.0 - 2.0] * 9]
    assert axes.get_ylabel() == "robustness of psi\n[m]"


def test_the_rewarded_form_is_drawn_where_it_is_asked_for_and_said():
    form = figure(OWN, bands=rewarded_band(), told=True, rewarded=REWARDED)
    (axes,) = form.axes
    assert axes.get_title(loc="left") == REWARDED
    assert drawn(axes, TRACE) == [[2.0 - 4.0] * 9]
    assert axes.get_ylabel() == "robustness of psi\n[rewarded form, no unit]"
    assert "of the rewarded form" in form.get_suptitle()
    assert drawn(axes, BOUNDS) == [[0] * 5, [1] * 5]
    assert BAND_ELSEWHERE not in legend(form)


def test_bounds_on_the_rewarded_form_are_not_drawn_over_the_own_predicate():
    own = figure(OWN, bands=rewarded_band(), rewarded=REWARDED)
    assert drawn(own.axes[0], BOUNDS) == []
    assert BAND_ELSEWHERE in legend(own)
    assert "the method's bounds" not in legend(own)
    assert BAND_ELSEWHERE not in legend(figure(OWN, rewarded=REWARDED))  # a method without bounds


def test_a_range_that_is_long_below_zero_is_logarithmic_there():
    wide = {"x": {"low": 9, "high": 1000, "unit": "m"}}  # margins in [-990.1, 0.9]
    (axes,) = figure("G[0,4] x <= 9.9", [[9.5] * 9], signals=wide).axes
    assert axes.get_yscale() == "symlog"
    assert axes.yaxis.get_transform().linthresh == 1
    assert axes.get_ylim()[0] < -990.1
    assert {-100, -10, -1, 0} <= set(axes.get_yticks())
    assert axes.get_ylabel() == "robustness of psi\n[m]\nlogarithmic beyond ±1"
    assert figure().axes[0].get_yscale() == "linear"


def test_a_formula_that_is_not_made_of_terms_has_no_figure():
    assert figure("G[0,2] F[0,2] x <= 1") is None
