"""Films as files: GIFs as Pillow reads them, and what ffmpeg is given, by a stand-in that writes it down."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from stlbench.errors import UsageError
from stlbench.report import film

COLOURS = np.array([[200, 0, 0], [0, 150, 0], [0, 0, 250]], dtype=np.uint8)


def picture(colour, height=5, width=7):
    """One colour on black, so that no picture has the colours of another."""
    found = np.tile(COLOURS[colour], (height, width, 1))
    found[0] = 0
    return found


def test_a_gif_has_the_pictures_in_their_order(tmp_path):
    path = tmp_path / "films" / "a.gif"
    film.write_video((picture(colour) for colour in (0, 1, 2)), path)
    with Image.open(path) as image:
        assert (image.format, image.size, image.n_frames, image.info["loop"]) == ("GIF", (7, 5), 3, 0)
        for i in range(3):
            image.seek(i)
            assert image.info["duration"] == 80
            assert np.array_equal(np.asarray(image.convert("RGB")), picture(i))


def test_a_webp_has_the_same_and_is_smaller(tmp_path):
    generator = np.random.default_rng(0)
    noise = generator.integers(0, 255, (64, 64, 3)).astype(np.uint8)
    for name in ("a.gif", "a.webp"):
        film.write_video(
            (np.roll(noise, shift, axis=1) // 2 + 10 * shift.astype(np.uint8) for shift in np.arange(4)),
            tmp_path / name,
        )
    with Image.open(tmp_path / "a.webp") as image:
        assert (image.format, image.size, image.n_frames, image.info["loop"]) == ("WEBP", (64, 64), 4, 0)
        means = []
        for i in range(4):
            image.seek(i)
            means.append(np.asarray(image.convert("RGB")).mean())
    assert means == sorted(means)
    assert means[3] - means[0] > 20
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
    film.check_format("mp4")
    film.write_video([picture(0), picture(1)], path)
    expected = np.stack([picture(0)[:4, :6], picture(1)[:4, :6]]).tobytes()
    assert path.read_bytes() == expected
    words = (tmp_path / "words").read_text().split()
    assert words[words.index("-s") + 1] == "6x4"
    assert words[words.index("-r") + 1] == "12.5"


def test_what_ffmpeg_says_is_one_line(ffmpeg, tmp_path):
    ffmpeg("cat > /dev/null; echo no such >&2; echo encoder >&2; exit 3")
    with pytest.raises(UsageError, match=r"^ffmpeg could not write .*a\.mp4: no such encoder$"):
        film.write_video([picture(0)], tmp_path / "a.mp4")


def test_without_ffmpeg_mp4_is_refused(monkeypatch):
    monkeypatch.setenv("PATH", "")
    film.check_format("gif")
    with pytest.raises(UsageError, match="mp4 needs the program ffmpeg"):
        film.check_format("mp4")
