"""What tells groups and terms apart."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.synthetic_results import result
from matplotlib import colormaps
from matplotlib.colors import to_rgb

from stlbench.report import condense
from stlbench.report.figures.palette import COLOURS, GROUPS_PER_FIGURE, TIME, TRACE, pages, styles, term_style


def test_all_groups_of_a_figure_have_colours_of_their_own():
    looks = styles(condense(result(f"method-{i:02}") for i in range(GROUPS_PER_FIGURE)))
    assert len({style.colour for style in looks}) == GROUPS_PER_FIGURE


def test_more_groups_than_colours_differ_in_their_lines():
    looks = styles(condense(result(f"method-{i:02}") for i in range(2 * GROUPS_PER_FIGURE)))
    assert len({(style.colour, style.line) for style in looks}) == 2 * GROUPS_PER_FIGURE


def test_twenty_terms_all_look_different():
    assert len({term_style(i) for i in range(20)}) == 20


def test_no_term_has_the_colour_of_traces_or_of_marks():
    assert not {term_style(i).colour for i in range(20)} & {TRACE, "#000000"}


def test_no_term_has_a_colour_of_the_time_along_a_trace():
    times = colormaps[TIME](np.linspace(0, 1, 256))[:, :3]
    for i in range(5):
        assert np.linalg.norm(times - to_rgb(term_style(i).colour), axis=1).min() > 0.2


# How the two kinds of red-green blindness see linear RGB (Vienot, Brettel and Mollon 1999).
PROTAN = [[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]]
DEUTAN = [[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]]


@pytest.mark.parametrize("seen", [PROTAN, DEUTAN], ids=["protan", "deutan"])
def test_a_colour_blind_reader_tells_the_colours_apart(seen):
    linear = np.array([to_rgb(colour) for colour in COLOURS]) ** 2.2
    shown = np.clip(linear @ np.transpose(seen), 0, 1) ** (1 / 2.2)
    apart = np.linalg.norm(shown[:, None] - shown, axis=-1)[np.triu_indices(len(COLOURS), 1)]
    assert apart.min() > 0.14


def test_pages_have_about_as_many_groups_each():
    groups = condense(result(f"method-{i}") for i in range(5))
    assert [(end, [str(group.setting.method)[-1] for group in page]) for end, page in pages(groups, 3)] == [
        ("", ["0", "1"]),
        ("_2", ["2", "3", "4"]),
    ]
    assert [len(page) for _, page in pages(range(14))] == [7, 7]
    assert list(pages([])) == []
