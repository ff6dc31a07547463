"""The figure of all tasks, read back from matplotlib's own objects."""

from __future__ import annotations

import numpy as np
import pytest

from stlbench.report.figures.across import across_tasks, place, profiles, ranks, ticks
from stlbench.report.figures.files import drawings_across
from stlbench.report.figures.methods import groups, satisfied
from stlbench.report.figures.style import COLOURS
from stlbench.report.tables.across import Entry, Field
from stlbench.statistics import across

COLOURED = dict(zip(["bad", "good", *(f"method-{i}" for i in range(9))], COLOURS, strict=False))
GOOD = Entry("good", ((0.99, 0.9), (0.9, 0.99), (0.9, 0.9)), "")
BAD = Entry("bad", ((0.5, 0.5), (0.5, 0.5), ()), "2 intractable")
EVERY = Field("quick", "shared", ("one", "two", "three"), "all 3", (BAD, GOOD))
FIT = "2 of 3, all methods fit"
COMMON = Field(
    "quick", "shared", ("one", "two"), FIT, (Entry("bad", BAD.scores[:2], ""), Entry("good", GOOD.scores[:2], ""))
)


@pytest.fixture(autouse=True)
def brief(monkeypatch):
    """Intervals from few resamples, which take little time."""
    monkeypatch.setattr(across, "RESAMPLES", 99)


def test_what_lacks_a_tenth_is_one_further():
    assert [place(score) for score in (-9, 0, 0.9, 0.99)] == pytest.approx([-1, 0, 1, 2])
    assert place(0.999) == place(1.0) == place(1.5) == pytest.approx(3)


@pytest.mark.parametrize(
    ("ends", "texts"),
    [
        ((0.32, 0.97), ["0.3", "0.6", "0.8", "0.9", "0.95", "0.98"]),
        ((-1.2, 0.95), ["-3", "-1", "0", "0.5", "0.9", "0.99"]),
        ((-40, 1.2), ["-100", "-10", "-1", "0", "0.5", "0.9", "0.99", "0.999"]),
    ],
)
def test_the_numbers_on_the_axis_lie_around_the_data(ends, texts):
    assert [text for _, text in ticks(*ends)] == texts


def test_each_method_has_its_aggregates_and_its_profile_in_its_colour():
    left, right = across_tasks([EVERY, COMMON], COLOURED).axes
    colours = [COLOURED["bad"], COLOURED["good"]]
    assert [line.get_color() for line in right.lines] == colours
    assert [line.get_color() for line in left.lines if line.get_marker() in "Ds"] == 2 * colours
    assert "logarithmic" in left.get_xlabel()
    assert [label.get_text() for label in left.get_yticklabels()] == ["bad\n(fits 2 of 3)", "good"]
    marked = {
        (line.get_marker(), round(line.get_ydata()[0], 2)): line for line in left.lines if line.get_marker() in "Ds"
    }
    assert set(marked) == {("D", -0.13), ("D", 0.87), ("s", 0.13), ("s", 1.13)}
    assert marked["s", 0.13].get_xdata()[0] == pytest.approx(place(0.5))


def test_a_profile_falls_from_all_runs_to_none():
    _, right = across_tasks([EVERY], COLOURED).axes
    bad, good = (line.get_ydata() for line in right.lines)
    assert bad[1:].tolist() == sorted(bad[1:], reverse=True)
    assert good[0] == 100
    assert (bad[-1], good[-1]) == (0, 0)
    assert bad[1] == 100  # of the tasks that it fits


def test_the_band_of_a_profile_is_its_interval():
    _, right = across_tasks([EVERY], COLOURED).axes
    _, shares = profiles(EVERY)
    for band, line in zip(right.collections, shares, strict=True):
        ends = {round(100 * end, 6) for _, interval in line for end in interval}
        assert set(np.round(band.get_paths()[0].vertices[:, 1], 6)) == ends


def test_no_panel_of_profiles_has_a_colour_twice():
    entries = tuple(Entry(f"method-{i}", GOOD.scores, "") for i in range(9))
    figure = across_tasks([Field("quick", "shared", EVERY.tasks, "all 3", entries)], COLOURED)
    _, *panels = figure.axes
    assert [len(axes.lines) for axes in panels] == [4, 5]
    assert all(len({line.get_color() for line in axes.lines}) == len(axes.lines) for axes in panels)


def test_one_figure_for_each_budget_and_track():
    plain = Field("quick", "plain", EVERY.tasks, "all 3", EVERY.entries)
    names = [each.name for each in drawings_across((plain, EVERY, COMMON), COLOURED)]
    assert names == ["across-quick-plain", "across-quick-shared"]
    assert drawings_across((), COLOURED) == []


def drawn(methods, tasks):
    """A field of a suite: the first method is best on every task, the next second, and so on."""
    names = list(COLOURED)[:methods]
    shares = ((1.0, 0.7),) * tasks
    entries = tuple(Entry(name, ((1 - i / 10,) * 2,) * tasks, "", satisfaction=shares) for i, name in enumerate(names))
    return Field("quick", "auto", tuple(map(str, range(tasks))), "all", entries, ({"system": "arm"},) * tasks)


def test_ranks_are_drawn_of_three_methods_that_fit_eight_drawn_tasks():
    names = [each.name for each in drawings_across((drawn(3, 8),), COLOURED)]
    assert names == [f"{kind}-quick-auto" for kind in ("across", "groups", "satisfied", "ranks")]
    for field, count in ((drawn(2, 8), 3), (drawn(3, 7), 3), (EVERY, 1)):
        assert len(drawings_across((field,), COLOURED)) == count


def test_groups_of_drawn_tasks_have_a_figure() -> None:
    """One row for each group, kinds apart; a method that fits no task of a group has no entry."""
    first, second, third = drawn(3, 2).entries
    none = Entry(third.method, ((), ()), "", satisfaction=((), ()))
    part = Entry(second.method, (second.scores[0], ()), "", satisfaction=(second.satisfaction[0], ()))
    systems = ({"system": "arm"}, {"system": "pair"})
    figure = groups(Field("quick", "auto", ("a", "b"), "all", (first, part, none), systems))
    everything, by_system = figure.axes
    assert [[text.get_text() for text in axes.get_yticklabels()] for axes in figure.axes] == [["all"], ["arm", "pair"]]
    assert [text.get_text() for text in everything.texts] == ["50\n1.00", "50\n0.90"]
    assert by_system.images[0].get_array().mask.tolist() == [[False, False, True], [False, True, True]]
    assert [text.get_position() for text in by_system.texts] == [(0, 0), (1, 0), (0, 1)]


def test_a_method_that_does_not_fit_the_common_tasks_has_its_numbers_in_brackets() -> None:
    """Of three tasks the second method fits the first alone: it is not compared."""
    first, second = drawn(2, 3).entries
    few = Entry(second.method, (second.scores[0], (), ()), "", satisfaction=(second.satisfaction[0], (), ()))
    (axes, _) = groups(Field("quick", "auto", ("a", "b", "c"), "all", (first, few), ({"system": "arm"},) * 3)).axes
    assert [text.get_text() for text in axes.texts] == ["50\n1.00", "(50)\n(0.90)"]
    assert axes.images[0].get_array().mask.tolist() == [[False, True]]


def test_the_share_of_runs_that_satisfy_so_much_is_drawn_over_the_common_tasks() -> None:
    """Seeds satisfy from 1 and .7 of the starts; the second method fits one of two tasks, there from 1 and .5."""
    first, second = drawn(2, 2).entries
    part = Entry(second.method, (second.scores[0], ()), "", satisfaction=((1.0, 0.5), ()))
    (axes,) = satisfied(
        Field("quick", "auto", ("a", "b"), "all", (first, part), ({"system": "arm"},) * 2), COLOURED
    ).axes
    own, other = (dict(zip(*line.get_data(), strict=True)) for line in axes.lines[:2])
    assert [own[at] for at in (50, 70, 71, 95, 100)] == [100, 100, 50, 50, 50]
    assert [other[at] for at in (50, 51, 100)] == [100, 50, 50]


def test_methods_that_are_nearer_than_the_critical_difference_have_a_bar():
    """Six tasks and three methods: the difference is 2.343 sqrt(12 / 36) = 1.353, so 1 and 3 alone are apart."""
    (axes,) = ranks(drawn(3, 6), COLOURED).axes
    texts = [label.get_text() for label in axes.get_yticklabels()]
    assert texts == [*list(COLOURED)[:3], "may be alike", "may be alike", "critical difference"]
    bars = [line.get_xdata() for line in axes.lines if line.get_linewidth() == 2.5]
    assert [list(ends) for ends in bars] == [[1, 2], [2, 3]]
