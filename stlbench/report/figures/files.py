"""Files of figures: their names, and writing PNG and SVG."""

from __future__ import annotations

import re
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure
from PIL import Image

from stlbench.errors import UsageError

__all__ = ["file_name", "save"]


def file_name(*parts: str) -> str:
    """The parts as one name of a file, such as time-hold-disc-funnel. Raises `UsageError` where that could be a path.

    Names of plugins and their parameters always can name a file; a ledger from elsewhere may hold anything.
    """
    for part in parts:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.,=+\[\]-]*", part):
            raise UsageError(f"{part!r} cannot name a figure's file: letters, digits and _ . , = + - [ ] can")
    return "-".join(parts)


def save(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write the figure as `name`.png and `name`.svg, the same bytes whenever it is drawn again; their paths.

    The PNG has 256 colours, a third of the size: reports are committed. They are chosen for coverage; by the usual
    median cut, colours of few pixels such as a legend's were merged with their neighbours.
    """
    folder.mkdir(parents=True, exist_ok=True)
    png, svg = folder / f"{name}.png", folder / f"{name}.svg"
    with mpl.rc_context({"svg.hashsalt": "stlbench"}):
        figure.savefig(png, dpi=120)
        figure.savefig(svg, metadata={"Date": None})
    with Image.open(png) as picture:
        few = picture.convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    few.save(png, optimize=True)
    return [png, svg]
