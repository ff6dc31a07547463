"""Names of files, styles, and files that are the same whenever they are drawn."""

from __future__ import annotations

import pytest
from helpers.synthetic_results import result
from matplotlib.figure import Figure

from stlbench.errors import UsageError
from stlbench.report import condense
from stlbench.report.figures.drawing import COLOURS, MOST, file_name, of_term, save, styles


def test_parts_of_a_name():
    assert file_name("time", "hold-disc", "funnel[ginf=0.02,t_star=1]") == "time-hold-disc-funnel[ginf=0.02,t_star=1]"


@pytest.mark.parametrize("part", ["../x", "a/b", "", ".hidden", "a b", "C:x", "a\nb", "-a"])
def test_what_could_be_a_path_is_refused(part):
    with pytest.raises(UsageError, match="cannot name a figure's file"):
        file_name("time", part)


def test_up_to_so_many_groups_all_look_different():
    found = styles(condense(result(f"method-{i:02}") for i in range(MOST)))
    assert len({(style.colour, style.line) for style in found}) == MOST


def test_no_term_has_the_colour_of_traces_or_of_marks():
    assert not {of_term(i) for i in range(20)} & {COLOURS[0], "#000000"}
    assert len({of_term(i) for i in range(5)}) == 5


def test_the_same_figure_gives_the_same_files(tmp_path):
    def drawn(folder):
        figure = Figure()
        figure.subplots().plot([0, 1], [0, 1])
        return save(figure, tmp_path / folder, "name")

    (png, svg), again = drawn("a"), drawn("b")
    assert (png.name, svg.name) == ("name.png", "name.svg")
    assert png.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert [path.read_bytes() for path in (png, svg)] == [path.read_bytes() for path in again]
