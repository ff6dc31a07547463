"""What tells things in a figure apart: colours, lines and hatches, of groups of cells and of a task's terms."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Literal, NamedTuple, TypeVar

from stlbench.report.tables.rows import Group

__all__ = ["COLOURS", "GROUPS_PER_FIGURE", "TIME", "TRACE", "GroupStyle", "TermStyle", "pages", "styles", "term_style"]

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's palette without its yellow, which is hard to see on white; told apart by colour-blind readers."""
TRACE = COLOURS[0]
"""Of recorded traces, in figures of one method."""
TIME = "cividis"
"""Colours of the time along a trace: from blue to yellow, so that no term's colour is among them."""
Shown = TypeVar("Shown")
Line = Literal["-", "--", ":"]
LINES: tuple[Line, ...] = ("-", "--", ":")
GROUPS_PER_FIGURE = len(COLOURS)
"""In figures that tell them apart by colour."""
TERM_COLOURS = COLOURS[1:6]
"""Without those of traces and of their ends."""
HATCHES = ("", "///", "...", "xxx")


class GroupStyle(NamedTuple):
    """How one group looks in every figure of its task."""

    label: str
    """The method, with agent and budget where they differ, and how many seeds finished: "flag: 4 of 5 seeds"."""
    colour: str
    line: Line


class TermStyle(NamedTuple):
    """How the region of one term of a task is filled."""

    colour: str
    hatch: str
    """Empty for the first terms; further terms have a hatch beside their colour."""


def styles(groups: Sequence[Group]) -> list[GroupStyle]:
    """The styles of the groups of one task; `GROUPS_PER_FIGURE` differ in colour, further ones in their line."""
    several = [len({getattr(group.setting, name) for group in groups}) > 1 for name in ("agent", "budget", "track")]
    result = []
    for i, group in enumerate(groups):
        parts = (str(group.setting.agent), group.setting.budget, group.setting.track)
        further = [part for part, shown in zip(parts, several, strict=True) if shown]
        label = f"{', '.join([str(group.setting.method), *further])}: {_standing(group)}"
        result.append(GroupStyle(label, COLOURS[i % len(COLOURS)], LINES[i // len(COLOURS) % len(LINES)]))
    return result


def _standing(group: Group) -> str:
    """ "4 of 5 seeds, 1 timeout"; "intractable" where all seeds ended alike without a result."""
    ended = Counter(row.status for row in group.rows if row.numbers is None)
    if not group.done and len(ended) == 1:
        return next(iter(ended))
    parts = [f"{len(group.done)} of {len(group.rows)} seeds", *(f"{count} {status}" for status, count in ended.items())]
    return ", ".join(parts)


def pages(shown: Sequence[Shown], size: int = GROUPS_PER_FIGURE) -> Iterator[tuple[str, Sequence[Shown]]]:
    """At most `size` groups, or others, at a time, about as many on each page, and how names of their files end.

    The endings are "", then "_2", "_3", ...
    """
    count = math.ceil(len(shown) / size)
    ends = [round(i * len(shown) / count) for i in range(count + 1)] if count else []
    for i, (start, end) in enumerate(pairwise(ends)):
        yield f"_{i + 1}" if i else "", shown[start:end]


def term_style(i: int) -> TermStyle:
    """The style of term i of a task; the first 20 are all different."""
    return TermStyle(TERM_COLOURS[i % len(TERM_COLOURS)], HATCHES[i // len(TERM_COLOURS) % len(HATCHES)])
