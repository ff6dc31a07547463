"""Files of figures, PNG, SVG and PDF: their names, writing them, and what each of them says it was drawn from."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from hashlib import sha256
from importlib import metadata
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import stlbench
from stlbench.errors import UsageError
from stlbench.records.outputs import write
from stlbench.report.figures.style import format_now, rc

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HEAD = 4096
"""Bytes of a file within which it says what it was drawn from."""
_ENDS = ("png", "svg", "pdf")
_DPI = 200


def file_name(*parts: str) -> str:
    """The parts as one name of a file, such as time-hold-disc-funnel. Raises `UsageError` where that could be a path.

    Names of plugins and their parameters always can name a file; a ledger from elsewhere may hold anything.
    """
    for part in parts:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.,=+\[\]-]*", part):
            raise UsageError(f"{part!r} cannot name a figure's file: letters, digits and _ . , = + - [ ] can")
    return "-".join(parts)


def source_of(*values: object) -> str:
    """A digest (64 hex digits) of what a figure is drawn from: its values (as `repr`), format and code."""
    return sha256(repr((_drawing(), format_now(), values)).encode()).hexdigest()


@cache
def _drawing() -> tuple[str, ...]:
    """What draws: versions, and the code of this room, so that a change of it shows without a new version."""
    code = sha256()
    for path in sorted(Path(__file__).parents[1].rglob("*.py")):
        code.update(path.read_bytes())
    return stlbench.__version__, metadata.version("matplotlib"), code.hexdigest()


def drawn(folder: Path, name: str, source: str) -> list[Path]:
    """The files of a figure where all are there and were drawn from this source (`source_of`); else none.

    A PDF says nothing of its source within its first bytes; it is written before the others, which do.
    """
    png, svg, pdf = (folder / f"{name}.{end}" for end in _ENDS)
    alike = pdf.is_file() and all(source.encode() in _head(path) for path in (png, svg))
    return [png, svg, pdf] if alike else []


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(_HEAD)
    except OSError:
        return b""


def save(figure: Figure, folder: Path, name: str, source: str = "") -> list[Path]:
    """Write the figure as `name`.png, .svg and .pdf, the same bytes whenever it is drawn again; their paths.

    In the vector files text is text.

    The PNG has 256 colours, a third of the size: reports are committed. They are chosen for coverage; by the usual
    median cut, colours of few pixels such as a legend's were merged with their neighbours.

    Args:
        figure: what to write.
        folder: is made where it is not there.
        name: without the ending.
        source: of the figure (`source_of`), kept in PNG and SVG for `drawn`; none is kept where it is empty.
    """
    import matplotlib as mpl
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    picture, few, svg, pdf, note = BytesIO(), BytesIO(), BytesIO(), BytesIO(), PngInfo()
    with mpl.rc_context(rc()):
        figure.savefig(pdf, format="pdf", metadata={"CreationDate": None})
        figure.savefig(picture, format="png", dpi=_DPI)
        figure.savefig(svg, format="svg", metadata={"Date": None, "Identifier": source or None})
    if source:
        note.add_text("Source", source)
    colours = Image.open(picture).convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    colours.save(few, format="png", optimize=True, pnginfo=note)
    for end, file in (("pdf", pdf), ("svg", svg), ("png", few)):
        write(folder / f"{name}.{end}", file.getvalue())
    return [folder / f"{name}.{end}" for end in _ENDS]


def save_svg(figure: Figure, path: Path) -> None:
    """Write the figure as SVG alone, the same bytes whenever it is drawn again."""
    path.write_bytes(_svg(figure))


def svg_of(figure: Figure) -> bytes:
    """The figure as SVG without a background, letters as shapes: it looks the same without its font."""
    return _svg(figure, {"svg.fonttype": "path"}, transparent=True)


def _svg(figure: Figure, settings: Mapping[str, Any] | None = None, **words: Any) -> bytes:
    import matplotlib as mpl

    file = BytesIO()
    with mpl.rc_context(rc() | dict(settings or {})):
        figure.savefig(file, format="svg", metadata={"Date": None}, **words)
    return file.getvalue()
