"""The overview as a figure: a number for each task and method, and nothing that is cut off in a column."""

from __future__ import annotations

import pytest
from helpers.synthetic_results import result

from stlbench.report import condense
from stlbench.report.figures.files import Drawing, drawings_of_overview
from stlbench.report.figures.style import fitting
from stlbench.report.tables.table import Width

METHODS = [
    "causation",
    "counters",
    "dense",
    "flag",
    "funnel",
    "machine",
    "raw",
    "sparse",
    "tau-cmdp",
    "tau-mdp",
    "tltl",
]


def drawn(tasks: int, methods: list[str]) -> list[Drawing]:
    made = [
        result(method, seed, task=f"double-integrator-sequence-{number}", robustness=[0.4, seed - 0.5])
        for number in range(tasks)
        for method in methods
        for seed in range(2)
    ]
    return drawings_of_overview(condense(made))


@pytest.mark.parametrize("width", ["column", "page"])
def test_it_fits(width: Width) -> None:
    (drawing,) = drawn(12, METHODS)
    with fitting(width):
        figure = drawing.draw()
    figure.draw_without_rendering()
    whole = figure.bbox
    for text in figure.findobj(match=lambda artist: hasattr(artist, "get_text") and artist.get_text()):
        box = text.get_window_extent()
        assert whole.x0 <= box.x0 <= box.x1 <= whole.x1, text
        assert whole.y0 <= box.y0 <= box.y1 <= whole.y1, text
    (axes,) = figure.axes
    assert [text.get_text() for text in axes.texts] == ["1"] * 12 * len(METHODS)
    assert axes.images[0].get_array().tolist() == [[0.5] * len(METHODS)] * 12
    assert "of 2; the colour" in figure.legends[0].get_texts()[0].get_text()


def test_numbers_of_seeds_that_differ_are_a_range() -> None:
    made = [result(method, seed, task=task) for method in ("flag", "raw") for task in "ab" for seed in range(2)]
    (drawing,) = drawings_of_overview(condense([*made, result("raw", 2, task="b")]))
    assert "of 2 to 3; the colour" in drawing.draw().legends[0].get_texts()[0].get_text()


def test_many_tasks_have_several_figures_and_one_has_none() -> None:
    assert [drawing.name for drawing in drawn(60, ["flag", "raw"])] == ["overview", "overview_2"]
    assert drawn(1, ["flag", "raw"]) == drawn(2, ["flag"]) == []


def test_a_method_without_a_result_has_a_dot() -> None:
    made = [result(method, task=task) for method in ("flag", "raw") for task in ("hold-disc", "reach-stay")]
    made.append(result("sparse", status="timeout", task="hold-disc"))
    (drawing,) = drawings_of_overview(condense(made))
    (axes,) = drawing.draw().axes
    assert [text.get_text() for text in axes.texts] == ["1", "1", "·", "1", "1"]
