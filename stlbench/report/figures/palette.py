"""What tells things in a figure apart: colours, lines and hatches, of groups of cells and of a task's terms."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import cycle, pairwise
from typing import Literal, NamedTuple, TypeVar

from stlbench.report.tables.planned import split
from stlbench.report.tables.rows import Group

Colours = Mapping[str, str]
"""Method -> its colour, on every chart of a folder of results."""
SAFE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's palette without its yellow, which is hard to see on white; told apart by colour-blind readers."""
_FURTHER = ("#8C6D31", "#C2185B", "#5E9C1F", "#6B6ECF", "#A55194", "#17A2A2", "#8F8F8F")
"""Of as many more methods; also of terms, which seldom meet so many."""
COLOURS = (*SAFE, *_FURTHER)
"""Of methods, and of nothing else."""
INK, TRACE, MARK, BOUNDS = "0.15", "0.3", "#A00000", "#6A3D9A"
"""What belongs to no method: what is best possible, recorded traces, what decides, a method's own bounds."""
TIME = "cividis"
"""Colours of the time along a trace: from blue to yellow, so that no term's colour is among them."""
Shown = TypeVar("Shown")
Line = Literal["-", "--", ":"]
LINES: tuple[Line, ...] = ("-", "--", ":")
GROUPS_PER_FIGURE = len(SAFE)
"""In figures that tell them apart by colour."""
TERM_COLOURS = _FURTHER[:5]
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


def colours_of(groups: Sequence[Group]) -> Colours:
    """The colour of each method, given all groups of a folder; after `COLOURS` methods they come again.

    Methods that learned come first, by name; then those that were only planned for.
    """
    learned = {str(group.setting.method) for group in split(groups)[0]}
    planned = {str(group.setting.method) for group in groups} - learned
    return dict(zip([*sorted(learned), *sorted(planned)], cycle(COLOURS), strict=False))


def lines_of(colours: Iterable[str]) -> list[Line]:
    """For lines of these colours on one chart: those of one colour differ in how they are drawn, first solid."""
    seen = Counter[str]()
    result = list[Line]()
    for colour in colours:
        result.append(LINES[seen[colour] % len(LINES)])
        seen[colour] += 1
    return result


def styles(groups: Sequence[Group], colours: Colours) -> list[GroupStyle]:
    """The styles of groups that one chart of their task shows; `colours` of their methods."""
    several = [len({getattr(group.setting, name) for group in groups}) > 1 for name in ("agent", "budget", "track")]
    result, own = list[GroupStyle](), [colours[str(group.setting.method)] for group in groups]
    for group, colour, line in zip(groups, own, lines_of(own), strict=True):
        parts = (str(group.setting.agent), group.setting.budget, group.setting.track)
        further = [part for part, shown in zip(parts, several, strict=True) if shown]
        label = f"{', '.join([str(group.setting.method), *further])}: {_standing(group)}"
        result.append(GroupStyle(label, colour, line))
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
