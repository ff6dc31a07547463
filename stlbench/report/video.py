"""Pictures as a film: GIF and WebP by Pillow, MP4 by the program ffmpeg."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO, Literal

import numpy as np
from PIL import Image

from stlbench.contract.presentation import Pixels
from stlbench.errors import UsageError
from stlbench.records.outputs import opened
from stlbench.records.outputs import write as write_file

Format = Literal["gif", "webp", "mp4"]

FRAMES_A_SECOND = 12.5
"""GIF counts in hundredths of a second: 8 of them a frame."""


def check_format(form: Format) -> None:
    """Raise `UsageError` where this machine cannot write such a file."""
    if form == "mp4":
        _ffmpeg()


def write(pictures: Iterable[Pixels], path: Path) -> None:
    """Write pictures (height, width, 3) of one size as a film; the path's ending says as what.

    Raises:
        UsageError: there is no ffmpeg, or it fails, or the file cannot be written.
    """
    if path.suffix == ".mp4":
        _mp4(pictures, path)
        return
    images = [Image.fromarray(picture) for picture in pictures]  # drawn before the file is there
    with opened(path) as file:
        (_webp if path.suffix == ".webp" else _gif)(images, file)


def _gif(images: Sequence[Image.Image], file: BinaryIO) -> None:
    """Each frame has 256 colours of its own: those of the first may lack what moves into the picture later."""
    first, *rest = [image.quantize(256) for image in images]
    duration = round(1000 / FRAMES_A_SECOND)
    first.save(file, format="gif", save_all=True, append_images=rest, duration=duration, loop=0)


def _webp(images: Sequence[Image.Image], file: BinaryIO) -> None:
    """Smaller than a GIF, with all colours; edges are a little soft."""
    first, *rest = images
    duration = round(1000 / FRAMES_A_SECOND)
    first.save(file, "webp", save_all=True, append_images=rest, duration=duration, loop=0, quality=60, method=3)


def _mp4(pictures: Iterable[Pixels], path: Path) -> None:
    # its usual encoding wants even sizes
    even = [picture[: len(picture) // 2 * 2, : picture.shape[1] // 2 * 2] for picture in pictures]
    height, width = even[0].shape[:2]
    raw = ("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(FRAMES_A_SECOND), "-i", "-")
    content = np.stack(even).tobytes()
    with TemporaryDirectory(prefix="stlbench-film-") as place:
        film = Path(place, "film.mp4")
        command = [_ffmpeg(), "-y", "-loglevel", "error", *raw, "-pix_fmt", "yuv420p", str(film)]
        done = subprocess.run(command, input=content, capture_output=True, check=False)  # noqa: S603
        if done.returncode:
            problem = " ".join(done.stderr.decode(errors="replace").split()) or f"exit code {done.returncode}"
            raise UsageError(f"ffmpeg could not write {path}: {problem}")
        write_file(path, film.read_bytes())


def _ffmpeg() -> str:
    program = shutil.which("ffmpeg")
    if program is None:
        raise UsageError("mp4 needs the program ffmpeg, which is not on the PATH; --format gif does without")
    return program
