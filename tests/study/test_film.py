"""Films: which starts, which samples, how fast, what is shown; files as Pillow reads them, and what ffmpeg is given."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.line_task import FILE, Line, line
from matplotlib.image import AxesImage
from PIL import Image

from stlbench.errors import UsageError
from stlbench.records.array_files import Film
from stlbench.registry.choices import Choice
from stlbench.simulation.referee import Recording
from stlbench.study import film
from stlbench.task import load_task
from stlbench.task.task import Task

RECORDING = Recording(np.arange(27.0).reshape(3, 9, 1), seeds=1)
ROBUSTNESS = (0.5, 2.0, -1.25)


class Drawn(Line):
    """Draws itself as a picture whose every byte is its state."""

    def frame(self, state):
        return np.full((6, 8, 3), state[0], dtype=np.uint8)


class Broken(Line):
    """Cannot draw here."""

    def frame(self, state):
        raise RuntimeError("the pencils are missing")


def task(kind=Line, **changes):
    return Task(Choice("line"), line(**changes).file, kind(FILE["sampling_time"]))


def filmed():
    """States at the decisions of an episode with hold = 4: of the best start 10, 20, 30, of the worst 40, 50, 60."""
    states = np.arange(10.0, 70, 10).reshape(2, 3, 1)
    return Recording(RECORDING.traces, 1, Film(np.array([1, 2]), states))


@pytest.mark.parametrize(
    ("steps", "dt", "count", "speed"),
    [
        (2000, 0.01, 150, 20 / 12),  # 20 s, shown in 12
        (1000, 0.01, 125, 1),  # 10 s, as long as they last
        (200, 0.01, 50, 0.5),  # 2 s, shown in 4
        (4, 0.5, 5, 2 / (5 / 12.5)),  # no more pictures than samples
    ],
)
def test_pace(steps, dt, count, speed):
    found = film.pace(steps, dt)
    assert (len(found.samples), found.samples[0], found.samples[-1]) == (count, 0, steps)
    assert found.speed == pytest.approx(speed)
    assert len(set(found.samples.tolist())) == count


def test_the_best_start_is_left_the_worst_right_and_signals_grow_with_time():
    figure, update, _, remark = film.scene(task(), RECORDING, ROBUSTNESS)
    left, right = figure.axes
    assert left.get_title() == "best start: robustness 2"
    assert right.get_title() == "worst start: robustness -1.25"
    assert list(left.lines[0].get_ydata()) == list(range(9, 18))
    assert list(right.lines[0].get_ydata()) == list(range(18, 27))
    update(2)
    line_, head = left.lines
    assert (list(line_.get_xdata()), list(line_.get_ydata())) == ([0, 1, 2], [9, 10, 11])
    assert (list(head.get_xdata()), list(head.get_ydata())) == ([2], [11])
    assert remark == ""


@pytest.mark.parametrize("hold", [1, 4])
def test_pictures_keep_the_time_of_the_cell_whatever_the_task_holds_now(hold):
    """A cell of the track `tuned` may have held its actions for another number of steps than its task does."""
    _, update, images, _ = film.scene(task(Drawn, hold=hold), filmed(), ROBUSTNESS)
    shown = []
    for sample in (0, 3, 4, 8):
        update(sample)
        shown.append([int(image.get_array()[0, 0, 0]) for image in images])
    assert shown == [[10, 40], [10, 40], [20, 50], [30, 60]]


def test_a_task_with_a_plane_is_shown_in_it():
    disc = load_task("hold-disc")
    traces = np.random.default_rng(0).uniform(1, 3, (3, 201, 2))
    figure, update, _, _ = film.scene(disc, Recording(traces, 1), ROBUSTNESS)
    update(5)
    _, path, head = figure.axes[1].lines
    assert np.array_equal(np.array(path.get_data()).T, traces[2, :6])
    assert np.array_equal(np.array(head.get_data()).T, traces[2, 5:6])


def test_a_region_moves_with_the_signals_that_the_plane_does_not_show():
    """The zones of `zones` are discs of 0.4 m round three places, which are signals."""
    zones = load_task("zones")
    traces = np.zeros((1, 301, 8))
    traces[0, :, 2:] = [2, 0, 0, 2, -2, -2]
    traces[0, 200:, 2] = -1  # the first has moved
    _, update, (image, *_), _ = film.scene(zones, Recording(traces, 1), (1.0,))
    side = 201
    grid = np.stack(np.meshgrid(*[np.linspace(-3, 3, side)] * 2), axis=-1)
    for sample, first in ((0, 2), (300, -1)):
        update(sample)
        shown = image.get_array()[..., 3] > 0
        assert shown.shape == (side, side)
        far = [np.hypot(*(grid - place).T).T for place in ([first, 0], [0, 2], [-2, -2])]
        clear = np.min(far, axis=0) - 0.4
        assert np.array_equal(shown[np.abs(clear) > 1e-9], (clear > 0)[np.abs(clear) > 1e-9])


def test_a_part_that_reads_no_signal_of_the_plane_is_not_drawn_in_it():
    signals = {name: {"low": -10, "high": 10, "unit": "m"} for name in "xyz"}
    flat = task(signals=signals, plane=["x", "y"], formula="G[0,4] z <= 1")
    _, update, artists, _ = film.scene(flat, Recording(np.zeros((1, 9, 3)), 1), (1.0,))
    update(0)
    assert not any(isinstance(artist, AxesImage) for artist in artists)


def test_a_trace_that_leaves_the_picture_is_said_to():
    traces = np.full((3, 201, 2), 2.0)
    traces[2, 100:, 0] = 5  # of the worst start; the range of x is [0, 4]
    figure = film.scene(load_task("hold-disc"), Recording(traces, 1), ROBUSTNESS).figure
    titles = [axes.get_title() for axes in figure.axes]
    assert titles == ["best start: robustness 2", "worst start: robustness -1.25, leaves the picture"]


def test_pictures_of_an_environment_are_shown_as_they_come():
    asked = []

    def pictures(sample):
        asked.append(sample)
        return [np.full((6, 8, 3), 10 * i + sample, dtype=np.uint8) for i in (1, 2)]

    figure, update, images, remark = film.scene(task(), RECORDING, ROBUSTNESS, pictures)
    update(4)
    assert [int(image.get_array()[0, 0, 0]) for image in images] == [14, 24]
    assert (asked, remark) == ([0, 4], "")
    assert figure.axes[1].get_title() == "worst start: robustness -1.25"


@pytest.mark.parametrize(
    ("kind", "recording", "remark"),
    [
        (Broken, filmed(), "no pictures, the pencils are missing"),
        (Drawn, RECORDING, "no pictures of the system, as the cell's file of traces has no states"),
    ],
)
def test_where_no_picture_can_be_made_signals_are_shown_and_it_is_said(kind, recording, remark):
    found = film.scene(task(kind, hold=4), recording, ROBUSTNESS)
    assert found.remark.startswith(remark)
    assert len(found.figure.axes[0].lines) == 2


def test_a_film_moves_what_moves_keeps_what_stands_still_and_holds_the_end(monkeypatch, tmp_path):
    frames = []
    monkeypatch.setattr(film, "write_video", lambda pictures, path: frames.extend(pictures))
    assert film.write(task(), RECORDING, ROBUSTNESS, "line/raw/dqn/0", tmp_path / "line.gif") == ""
    assert len(frames) == 9 + 8
    shown = np.stack(frames[:9]).astype(int)
    height, width = shown.shape[1:3]
    changed = (shown != shown[0]).any(axis=(0, 3))
    assert changed[: height // 6].any()  # the time in the heading
    assert changed[height // 4 :, : width // 2].any()
    assert changed[height // 4 :, width // 2 :].any()
    assert changed.mean() < 0.2
    assert all(np.array_equal(frames[8], frame) for frame in frames[9:])


def test_a_film_has_the_ranges_of_the_task_file_and_names_every_part_of_the_formula():
    plane = {name: {"low": 0, "high": 5, "unit": "m"} for name in "xy"}
    formula = "F[0,4] (G[0,4] norm(x - 4, y - 4) <= 0.5 | G[0,4] norm(x - 4, y) <= 1)"
    moved = task(signals=plane, plane=["x", "y"], formula=formula)
    still = Recording(np.full((1, 9, 2), 2.0), seeds=1)
    figure = film.scene(moved, still, (-1.0,)).figure
    (axes,) = figure.axes
    assert (axes.get_xlim(), axes.get_ylim()) == ((0, 5), (0, 5))
    texts = [entry.get_text() for entry in figure.legends[0].get_texts()]
    assert texts == ["F[0,4] G[0,4] norm(x - 4, y - 4) <= 0.5", "F[0,4] G[0,4] norm(x - 4, y) <= 1"]
    far = Recording(np.stack([np.full((1, 9), 1.0), np.full((1, 9), 7.0)], axis=-1), seeds=1)
    rows = film.scene(task(signals=plane, formula="G[0,4] x <= 1"), far, (0.0,)).figure.axes
    assert [axes.get_ylim() for axes in rows] == [pytest.approx((-0.2, 5.2)), pytest.approx((-0.28, 7.28))]


COLOURS = np.array([[200, 0, 0], [0, 150, 0], [0, 0, 250]], dtype=np.uint8)


def picture(colour, height=5, width=7):
    """One colour on black, so that no picture has the colours of another."""
    found = np.tile(COLOURS[colour], (height, width, 1))
    found[0] = 0
    return found


@pytest.mark.parametrize(("form", "away"), [("gif", 0), ("webp", 40)])
def test_a_film_has_the_pictures_in_their_order(tmp_path, form, away):
    """WebP is not exact, but no colour looks like another, which is 150 away."""
    path = tmp_path / "films" / f"a.{form}"
    film.write_video((picture(colour, 32, 48) for colour in (0, 1, 2)), path)
    with Image.open(path) as image:
        assert (image.format, image.size, image.n_frames, image.info["loop"]) == (form.upper(), (48, 32), 3, 0)
        for i in range(3):
            image.seek(i)
            shown = np.asarray(image.convert("RGB")).astype(int)
            assert image.info["duration"] == 80
            assert abs(shown - picture(i, 32, 48))[4:].max() <= away


def test_a_webp_of_much_detail_is_smaller_than_the_gif(tmp_path):
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3)).astype(np.uint8)
    for name in ("a.gif", "a.webp"):
        film.write_video((np.roll(noise, shift, axis=1) for shift in range(4)), tmp_path / name)
    assert (tmp_path / "a.webp").stat().st_size < (tmp_path / "a.gif").stat().st_size


@pytest.fixture
def ffmpeg(tmp_path, monkeypatch):
    """A program ffmpeg that does what the shell is told: what it is given is in $@ and on its standard input."""

    def install(script):
        path = tmp_path / "bin" / "ffmpeg"
        path.parent.mkdir()
        path.write_text(f"#!/bin/sh\n{script}\n")
        path.chmod(0o755)
        monkeypatch.setenv("PATH", str(path.parent), prepend=":")

    return install


def test_ffmpeg_is_given_every_byte_and_even_sizes(ffmpeg, tmp_path):
    ffmpeg(f'echo "$@" > "{tmp_path}/words"; for last; do :; done; cat > "$last"')
    path = tmp_path / "a.mp4"
    film.write_video([picture(0), picture(1)], path)
    expected = np.stack([picture(0)[:4, :6], picture(1)[:4, :6]]).tobytes()
    assert path.read_bytes() == expected
    words = (tmp_path / "words").read_text().split()
    assert words[words.index("-s") + 1] == "6x4"
    assert words[words.index("-r") + 1] == "12.5"


def test_what_ffmpeg_says_is_one_line_and_without_it_mp4_is_refused(ffmpeg, tmp_path, monkeypatch):
    ffmpeg("cat > /dev/null; echo no such >&2; echo encoder >&2; exit 3")
    with pytest.raises(UsageError, match=r"^ffmpeg could not write .*a\.mp4: no such encoder$"):
        film.write_video([picture(0)], tmp_path / "a.mp4")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(UsageError, match="mp4 needs the program ffmpeg"):
        film.ffmpeg()
