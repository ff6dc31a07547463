"""One style for all figures."""

from __future__ import annotations

import math

import matplotlib as mpl
from helpers.synthetic_results import result
from matplotlib.figure import Figure

from stlbench.report import condense
from stlbench.report.figures.methods import learning_curves
from stlbench.report.figures.regions import Scale
from stlbench.report.figures.style import DOUBLE, SINGLE, colours_of, fitting, rc, styled


def test_what_is_drawn_has_the_style_and_leaves_none_behind():
    @styled
    def draw() -> Figure:
        figure = Figure()
        figure.subplots().set_title("title")
        return figure

    before = mpl.rcParams["axes.titlesize"], mpl.rcParams["font.size"]
    (axes,) = draw().axes
    assert axes.title.get_fontsize() == rc()["axes.titlesize"]
    assert (mpl.rcParams["axes.titlesize"], mpl.rcParams["font.size"]) == before


def test_a_figure_for_a_column_is_as_wide_as_one_and_has_text_of_a_paper():
    groups = condense(result(method, seed) for method in ("flag", "raw") for seed in (0, 1))
    with fitting("column"):
        figure = learning_curves(groups, Scale("m", math.inf), colours_of(groups))
    assert figure.get_figwidth() == SINGLE
    sizes = [text.get_fontsize() for text in figure.legends[0].get_texts()]
    sizes += [text.get_fontsize() for axes in figure.axes for text in (axes.xaxis.label, *axes.get_xticklabels())]
    assert set(sizes) == {8}
    assert learning_curves(groups, Scale("m", math.inf), colours_of(groups)).get_figwidth() == DOUBLE
