"""Names of files; files that are the same whenever they are drawn, and that keep every colour."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image

from stlbench.errors import UsageError
from stlbench.report.figures.files import file_name, save


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

    (png, svg), again = drawn("a"), drawn("b")
    assert (png.name, svg.name) == ("name.png", "name.svg")
    assert png.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert [path.read_bytes() for path in (png, svg)] == [path.read_bytes() for path in again]


def test_two_small_patches_of_like_colours_stay_apart_among_thousands_of_shades(tmp_path):
    """Fewer colours must not make one of a legend's vermilion and its orange, as pale as regions are."""
    figure = Figure(figsize=(4, 3))
    axes = figure.subplots()
    axes.set_axis_off()
    axes.imshow(np.random.default_rng(0).uniform(0, 1, (60, 80)), cmap="viridis", extent=(0, 1, 0, 1))
    axes.imshow(np.linspace(0, 1, 4000).reshape(50, 80), cmap="Blues", extent=(1, 2, 0, 1))
    pale = [(0.94, 0.80, 0.65), (0.96, 0.87, 0.65)]
    for i, colour in enumerate(pale):
        corner = (0.02 + 0.04 * i, 0.02)
        box = Rectangle(corner, 0.02, 0.02, transform=figure.transFigure, facecolor=colour, linewidth=0)
        figure.add_artist(box)
    png, _ = save(figure, tmp_path, "name")
    with Image.open(png) as picture:
        assert len(picture.getcolors()) <= 256
        pixels = np.asarray(picture.convert("RGB")).astype(int)
    for i, colour in enumerate(pale):
        at = pixels[pixels.shape[0] - 1 - round(0.03 * pixels.shape[0]), round((0.03 + 0.04 * i) * pixels.shape[1])]
        assert np.abs(at - np.round(np.multiply(colour, 255))).max() <= 12
