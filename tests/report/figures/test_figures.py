"""Figures: what is drawn where, read back from matplotlib's own objects."""

from __future__ import annotations

from dataclasses import replace

import pytest
from helpers.synthetic_results import result

from stlbench.errors import UsageError
from stlbench.registry.choices import Choice
from stlbench.report import condense
from stlbench.report.figures import figures
from stlbench.report.figures.drawing import MOST
from stlbench.report.figures.learning import learning_curves
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
    (axes,) = figures.robustness_by_method(GROUPS).axes
    drawn = [sorted(map(float, line.get_xdata())) for line in axes.lines]
    assert [-0.2] in drawn
    assert [0.1, 0.3] in drawn
    assert [pytest.approx(0.2)] in drawn


def test_a_method_without_a_result_keeps_its_place():
    (axes,) = figures.robustness_by_method(GROUPS).axes
    labels = [label.get_text() for label in axes.get_yticklabels()]
    assert labels == ["flag\n1 of 1 seeds", "funnel\n2 of 2 seeds", "tau-mdp\nintractable"]
    assert [(text.get_text(), text.get_position()[1]) for text in axes.texts] == [("no result", 2)]


def test_a_method_has_one_colour_in_both_figures():
    points = {
        line.get_color() for line in figures.robustness_by_method(GROUPS).axes[0].lines if line.get_marker() == "D"
    }
    curves = [line.get_color() for line in learning_curves(GROUPS).axes[0].lines]
    assert len(set(curves)) == 2
    assert set(curves) == points


def test_two_figures_a_task_as_png_and_svg(tmp_path):
    groups = condense([result(), result(task="other"), result(task="third", status="raised")])
    paths = figures.draw(groups, tmp_path)
    names = {
        f"{kind}-{task}.{end}"
        for kind in ("robustness", "learning")
        for task in ("hold-disc", "other")
        for end in ("png", "svg")
    }
    assert {path.name for path in paths} == {path.name for path in tmp_path.iterdir()} == names
    assert all(path.stat().st_size > 1000 for path in paths)


def test_the_same_results_give_the_same_file(tmp_path):
    figures.draw(GROUPS, tmp_path / "a")
    figures.draw(GROUPS, tmp_path / "b")
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()


def test_a_task_cannot_leave_the_folder(tmp_path):
    elsewhere = replace(result(), id=replace(result().id, task=Choice("../x")))
    with pytest.raises(UsageError, match=r"'\.\./x' cannot name a figure's file"):
        figures.draw(condense([elsewhere]), tmp_path / "figures")
    assert not list(tmp_path.iterdir())


def test_groups_that_do_not_fit_into_one_figure_go_into_the_next(tmp_path):
    results = [result(f"method-{i:02}", curve=curve((100, 1.0, 0.1))) for i in range(MOST + 1)]
    names = {path.name for path in figures.draw(condense(results), tmp_path)}
    assert {"robustness-hold-disc.png", "robustness-hold-disc_2.png", "learning-hold-disc_2.svg"} <= names
    assert len(names) == 8
