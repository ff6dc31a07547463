"""The figure of all tasks, read back from matplotlib's own objects."""

from __future__ import annotations

import pytest

from stlbench.report.figures import report_figures
from stlbench.report.figures.across import across_tasks, place
from stlbench.report.tables.across import Entry, Field

GOOD = Entry("good", ((0.99, 0.9), (0.9, 0.99), (0.9, 0.9)), "")
BAD = Entry("bad", ((0.5, 0.5), (0.5, 0.5), (0.0, 0.0)), "2 intractable")
EVERY = Field("quick", "shared", ("one", "two", "three"), 3, (BAD, GOOD))
COMMON = Field(
    "quick", "shared", ("one", "two"), 3, (Entry("bad", BAD.scores[:2], ""), Entry("good", GOOD.scores[:2], ""))
)


def test_what_lacks_a_tenth_is_one_further():
    assert [place(score) for score in (-9, 0, 0.9, 0.99)] == pytest.approx([-1, 0, 1, 2])
    assert place(0.999) == place(1.0) == place(1.5) == pytest.approx(3)


def test_each_method_has_its_aggregate_in_each_field():
    left, _ = across_tasks([EVERY, COMMON]).axes
    assert [label.get_text() for label in left.get_yticklabels()] == ["bad", "good"]
    marked = {
        (line.get_marker(), round(line.get_ydata()[0], 1)): line for line in left.lines if line.get_marker() in "Ds"
    }
    assert set(marked) == {("D", -0.1), ("D", 0.9), ("s", 0.1), ("s", 1.1)}
    assert marked["s", 0.1].get_xdata()[0] == pytest.approx(place(0.5))


def test_a_profile_falls_from_all_runs_to_none():
    _, right = across_tasks([EVERY]).axes
    bad, good = (line.get_ydata() for line in right.lines)
    assert bad[1:].tolist() == sorted(bad[1:], reverse=True)
    assert good[0] == 100
    assert (bad[-1], good[-1]) == (0, 0)
    at_random = bad[1]
    assert at_random == pytest.approx(100 * 4 / 6)


def test_the_legend_says_what_counts_as_no_better_than_random():
    (legend,) = across_tasks([EVERY, COMMON]).legends
    assert [text.get_text() for text in legend.get_texts()] == [
        "bad (2 intractable)",
        "good",
        "IQM over all 3, 95 % interval",
        "IQM over the 2 of 3 that all finished, 95 % interval",
    ]


def test_one_figure_for_each_budget_and_track(tmp_path):
    plain = Field("quick", "plain", EVERY.tasks, 3, EVERY.entries)
    paths = report_figures.draw_across((plain, EVERY, COMMON), tmp_path)
    assert [path.name for path in paths] == [
        *("across-quick-plain.png", "across-quick-plain.svg"),
        *("across-quick-shared.png", "across-quick-shared.svg"),
    ]
    assert report_figures.draw_across((), tmp_path) == []
