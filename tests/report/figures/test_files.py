"""Names of files; files that are the same whenever they are drawn, and that keep every colour."""

from __future__ import annotations

import pytest
from matplotlib.figure import Figure

from stlbench.errors import UsageError
from stlbench.report.figures.files import Drawing, file_name, save


def test_parts_of_a_name():
    assert file_name("time", "hold-disc", "funnel[ginf=0.02,t_star=1]") == "time-hold-disc-funnel[ginf=0.02,t_star=1]"


@pytest.mark.parametrize("part", ["../x", "a/b", "", ".hidden", "a b", "C:x", "a\nb", "-a"])
def test_what_could_be_a_path_is_refused(part):
    with pytest.raises(UsageError, match="cannot name a figure's file"):
        file_name("time", part)


def test_the_same_figure_gives_the_same_files(tmp_path):
    def drawn(folder):
        figure = Figure()
        figure.subplots().plot([0, 1], [0, 1])
        return save(figure, tmp_path / folder, "name")

    (png, svg, pdf), again = drawn("a"), drawn("b")
    assert (png.name, svg.name, pdf.name) == ("name.png", "name.svg", "name.pdf")
    assert png.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert [path.read_bytes() for path in (png, svg, pdf)] == [path.read_bytes() for path in again]


def test_text_in_vector_files_is_text(tmp_path):
    """So that it can be searched, read aloud and edited, and looks like the rest of a paper."""
    figure = Figure()
    figure.suptitle("robustness by method")
    _, svg, pdf = save(figure, tmp_path, "name")
    assert "robustness by method</text>" in svg.read_text(encoding="utf-8")
    assert b"/FontFile2" in pdf.read_bytes()  # TrueType, which journals take, not Type 3


class Blank(Drawing):
    """Takes no time to draw."""

    def draw(self):
        return Figure(figsize=(1, 1))


def drawing(values=(1, 2), name="some"):
    return Blank(name, "", ("across", "alignment"), values)


def written(folder, each):
    """Whether a figure is drawn."""
    before = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    return any(before.get(path) != path.stat().st_mtime_ns for path in each.write(folder))


def test_a_figure_is_drawn_again_if_its_values_changed_or_a_file_is_gone_or_another(tmp_path):
    assert written(tmp_path, drawing())
    assert not written(tmp_path, drawing())
    assert written(tmp_path, drawing((1, 3)))
    assert written(tmp_path, drawing(name="other"))
    for end in ("png", "svg", "pdf"):
        path = tmp_path / f"other.{end}"
        path.unlink()
        assert written(tmp_path, drawing(name="other"))
        if end != "pdf":  # which has no digest
            path.write_bytes(path.read_bytes()[:40])
            assert written(tmp_path, drawing(name="other"))
