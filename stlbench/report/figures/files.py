"""Files of figures, PNG, SVG and PDF. PNG and SVG have a digest of what they were drawn from."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from importlib import import_module, metadata
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
    """The parts as one name of a file, such as time-hold-disc-funnel. Raises `UsageError` if that could be a path.

    Names of plugins and their parameters can always name a file; a ledger of somebody else may have any text.
    """
    for part in parts:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.,=+\[\]-]*", part):
            raise UsageError(f"{part!r} cannot name a figure's file: letters, digits and _ . , = + - [ ] can")
    return "-".join(parts)


@dataclass(frozen=True)
class Drawing:
    """A figure of a report that can be drawn."""

    name: str
    """Of its files."""
    label: str
    """What it shows, for those who cannot see it."""
    function: tuple[str, str]
    """Module and name, in this room, of the function that draws it. The module imports matplotlib."""
    values: tuple[Any, ...]
    """The function's arguments: what it is drawn from."""

    def draw(self) -> Figure:
        """Draw it."""
        module, name = self.function
        figure: Figure = getattr(import_module(f"{__package__}.{module}"), name)(*self.values)
        return figure

    def write(self, folder: Path) -> list[Path]:
        """Write the files, unless they are there and were drawn from the same; their paths.

        A PDF has no digest within its first bytes; it is written before the others, which have it.
        """
        source = sha256(repr((_code(), format_now(), self.name, self.values)).encode()).hexdigest()
        png, svg, pdf = paths = [folder / f"{self.name}.{end}" for end in _ENDS]
        if pdf.is_file() and all(source.encode() in _head(path) for path in (png, svg)):
            return paths
        return save(self.draw(), folder, self.name, source)


@cache
def _code() -> tuple[str, ...]:
    """Versions, and the code of this room, so that a change of it shows without a new version."""
    code = sha256()
    for path in sorted(Path(__file__).parents[1].rglob("*.py")):
        code.update(path.read_bytes())
    return stlbench.__version__, metadata.version("matplotlib"), code.hexdigest()


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(_HEAD)
    except OSError:
        return b""


def save(figure: Figure, folder: Path, name: str, source: str = "") -> list[Path]:
    """Write the figure as `name`.png, .svg and .pdf, the same bytes whenever it is drawn again; their paths.

    In the vector files text is text. The PNG has 256 colours, a third of the size, since reports are committed. They
    are chosen for coverage: the usual median cut merged colours of few pixels, such as a legend's.

    Args:
        figure: what to write.
        folder: is made if it is not there.
        name: without the ending.
        source: a digest of what it was drawn from, kept in PNG and SVG; empty keeps none.
    """
    import matplotlib as mpl
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    picture, few, pdf, note = BytesIO(), BytesIO(), BytesIO(), PngInfo()
    with mpl.rc_context(rc()):
        figure.savefig(pdf, format="pdf", metadata={"CreationDate": None})
        figure.savefig(picture, format="png", dpi=_DPI)
    if source:
        note.add_text("Source", source)
    colours = Image.open(picture).convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    colours.save(few, format="png", optimize=True, pnginfo=note)
    contents = {"pdf": pdf.getvalue(), "svg": _svg(figure, source=source), "png": few.getvalue()}
    for end, content in contents.items():
        write(folder / f"{name}.{end}", content)
    return [folder / f"{name}.{end}" for end in _ENDS]


def save_svg(figure: Figure, path: Path) -> None:
    """Write the figure as SVG alone, the same bytes whenever it is drawn again."""
    path.write_bytes(_svg(figure))


def svg_of(figure: Figure) -> bytes:
    """The figure as SVG without a background, letters as shapes: it looks the same without its font."""
    return _svg(figure, {"svg.fonttype": "path"}, transparent=True)


def _svg(figure: Figure, settings: Mapping[str, str] | None = None, source: str = "", **options: bool) -> bytes:
    import matplotlib as mpl

    file = BytesIO()
    with mpl.rc_context(rc() | dict(settings or {})):
        figure.savefig(file, format="svg", metadata={"Date": None, "Identifier": source or None}, **options)
    return file.getvalue()
