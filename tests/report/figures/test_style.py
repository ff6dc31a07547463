"""One style for all figures, and what tells groups and terms apart."""

from __future__ import annotations

import math

import matplotlib as mpl
import numpy as np
import pytest
from helpers.synthetic_results import result
from matplotlib import colormaps
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from stlbench.records.result import Planned
from stlbench.report import condense
from stlbench.report.figures import style
from stlbench.report.figures.methods import learning_curves
from stlbench.report.figures.regions import Scale


def test_what_is_drawn_has_the_style_and_leaves_none_behind():
    @style.styled
    def draw() -> Figure:
        figure = Figure()
        figure.subplots().set_title("title")
        return figure

    before = mpl.rcParams["axes.titlesize"], mpl.rcParams["font.size"]
    (axes,) = draw().axes
    assert axes.title.get_fontsize() == style.rc()["axes.titlesize"]
    assert (mpl.rcParams["axes.titlesize"], mpl.rcParams["font.size"]) == before


def test_a_figure_for_a_column_is_as_wide_as_one_and_has_text_of_a_paper():
    groups = condense(result(method, seed) for method in ("flag", "raw") for seed in (0, 1))
    with style.fitting("column"):
        figure = learning_curves(groups, Scale("m", math.inf), style.colours_of(groups))
    assert figure.get_figwidth() == style.SINGLE
    sizes = [text.get_fontsize() for text in figure.legends[0].get_texts()]
    sizes += [text.get_fontsize() for axes in figure.axes for text in (axes.xaxis.label, *axes.get_xticklabels())]
    assert set(sizes) == {8}
    assert learning_curves(groups, Scale("m", math.inf), style.colours_of(groups)).get_figwidth() == style.DOUBLE


def test_a_method_has_one_colour_and_its_agents_differ_in_their_lines():
    groups = condense(result(method, agent=agent) for method in ("flag", "raw") for agent in ("dqn", "td3"))
    colours = style.colours_of(groups)
    looks = [(style.colour, style.line) for style in style.styles(groups, colours)]
    flag, raw = colours["flag"], colours["raw"]
    assert flag != raw
    assert looks == [(flag, "-"), (flag, "--"), (raw, "-"), (raw, "--")]


def test_planned_methods_do_not_change_the_colours_of_those_that_learned():
    learned = [result(method) for method in ("funnel", "raw")]
    planned = [result(method, agent="planner", planned=Planned("reward", 1.0)) for method in ("a", "raw", "verdict")]
    every = style.colours_of(condense([*learned, *planned]))
    assert every.items() >= style.colours_of(condense(learned)).items()
    assert len(set(every.values())) == len(every) == 4


@pytest.mark.parametrize("times", [1, 2])
def test_methods_have_colours_of_their_own_and_beyond_them_lines_of_their_own(times):
    groups = condense(result(f"method-{i:02}") for i in range(times * len(style.COLOURS)))
    assert len(set(style.colours_of(groups).values())) == len(style.COLOURS) == 2 * style.GROUPS_PER_FIGURE
    assert len({(style.colour, style.line) for style in style.styles(groups, style.colours_of(groups))}) == len(groups)


def test_what_belongs_to_no_method_has_no_colour_of_a_method():
    assert not {style.INK, style.TRACE, style.MARK, style.BOUNDS} & {*style.COLOURS}


def test_twenty_terms_all_look_different_and_none_has_a_colour_of_time():
    assert len({style.term_style(i) for i in range(20)}) == 20
    times = colormaps[style.TIME](np.linspace(0, 1, 256))[:, :3]
    for i in range(5):
        assert np.linalg.norm(times - to_rgb(style.term_style(i).colour), axis=1).min() > 0.2


# How the two kinds of red-green blindness see linear RGB (Vienot, Brettel and Mollon 1999).
PROTAN = [[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]]
DEUTAN = [[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]]


@pytest.mark.parametrize("seen", [PROTAN, DEUTAN], ids=["protan", "deutan"])
def test_a_colour_blind_reader_tells_the_colours_apart(seen):
    linear = np.array([to_rgb(colour) for colour in style.SAFE]) ** 2.2
    shown = np.clip(linear @ np.transpose(seen), 0, 1) ** (1 / 2.2)
    apart = np.linalg.norm(shown[:, None] - shown, axis=-1)[np.triu_indices(len(style.SAFE), 1)]
    assert apart.min() > 0.14


def test_pages_have_about_as_many_groups_each():
    groups = condense(result(f"method-{i}") for i in range(5))
    assert [(end, [str(group.setting.method)[-1] for group in page]) for end, page in style.pages(groups, 3)] == [
        ("", ["0", "1"]),
        ("_2", ["2", "3", "4"]),
    ]
    assert [len(page) for _, page in style.pages(range(14))] == [7, 7]
    assert list(style.pages([])) == []
