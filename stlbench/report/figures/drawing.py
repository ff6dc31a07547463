"""What figures share: colours, how a group looks and is called, file names, and writing PNG and SVG."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import matplotlib as mpl
from matplotlib.figure import Figure
from PIL import Image

from stlbench.errors import UsageError
from stlbench.report.tables.rows import Group

__all__ = ["COLOURS", "MOST", "Style", "file_name", "of_term", "pages", "save", "styles"]

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's palette without its yellow, which is hard to see on white; told apart by colour-blind readers."""
Line = Literal["-", "--", ":"]
LINES: tuple[Line, ...] = ("-", "--", ":")
MOST = len(COLOURS) * len(LINES)
"""Groups a figure."""


class Style(NamedTuple):
    """How one group looks in every figure of its task."""

    label: str
    """The method, with agent and budget where they differ, and how many seeds finished: "flag: 4 of 5 seeds"."""
    colour: str
    line: Line


def styles(groups: Sequence[Group]) -> list[Style]:
    """The styles of the groups of one task, at most `MOST` of them all different."""
    several = [len({getattr(group.setting, name) for group in groups}) > 1 for name in ("agent", "budget")]
    found = []
    for i, group in enumerate(groups):
        parts = (str(group.setting.agent), group.setting.budget)
        further = [part for part, shown in zip(parts, several, strict=True) if shown]
        label = f"{', '.join([str(group.setting.method), *further])}: {_standing(group)}"
        found.append(Style(label, COLOURS[i % len(COLOURS)], LINES[i // len(COLOURS) % len(LINES)]))
    return found


def _standing(group: Group) -> str:
    """ "4 of 5 seeds, 1 timeout"; "intractable" where all seeds ended alike without a result."""
    ended = Counter(row.status for row in group.rows if row.numbers is None)
    if not group.done and len(ended) == 1:
        return next(iter(ended))
    parts = [f"{len(group.done)} of {len(group.rows)} seeds", *(f"{count} {status}" for status, count in ended.items())]
    return ", ".join(parts)


def pages(groups: Sequence[Group]) -> Iterator[tuple[str, Sequence[Group]]]:
    """As many groups at a time as can be told apart, and how names of their files end: "", then "_2", "_3", ..."""
    for start in range(0, len(groups), MOST):
        yield f"_{start // MOST + 1}" if start else "", groups[start : start + MOST]


def of_term(i: int) -> str:
    """The colour of the task's term i; the first colour is that of traces."""
    return COLOURS[1 + i % (len(COLOURS) - 2)]


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

    The PNG has 256 colours, a third of the size: reports are committed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    png, svg = folder / f"{name}.png", folder / f"{name}.svg"
    with mpl.rc_context({"svg.hashsalt": "stlbench"}):
        figure.savefig(png, dpi=120)
        figure.savefig(svg, metadata={"Date": None})
    with Image.open(png) as picture:
        few = picture.convert("RGB").quantize(256, dither=Image.Dither.NONE)
    few.save(png, optimize=True)
    return [png, svg]
