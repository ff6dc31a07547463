"""The style of all figures: sizes as a paper prints them, and the looks of groups and terms."""

# matplotlib is imported late: a report whose figures are up to date does not need it

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from itertools import cycle, pairwise
from typing import Any, Literal, NamedTuple, ParamSpec, TypeVar

from stlbench.report.tables.rows import Group, split, unfinished
from stlbench.report.tables.table import Width

SINGLE, DOUBLE = 3.5, 7.16  # inches: the width of one column and of two, in journals and proceedings of IEEE


class Format(NamedTuple):
    width: float  # inches
    text: float  # points: of labels and titles of axes
    small: float  # of ticks and legends
    tiny: float  # of long texts


_FORMATS: dict[Width, Format] = {"page": Format(DOUBLE, 8, 7, 6), "column": Format(SINGLE, 8, 8, 7)}
_now: ContextVar[Format] = ContextVar("format", default=_FORMATS["page"])


@contextmanager
def fitting(wanted: Width) -> Iterator[None]:
    """Figures drawn within fit a column of a paper, or the page."""
    before = _now.set(_FORMATS[wanted])
    try:
        yield
    finally:
        _now.reset(before)


def now() -> Format:
    return _now.get()


def rc() -> dict[Any, Any]:
    sizes = _now.get()
    return {
        "font.family": ["DejaVu Sans"],  # comes with matplotlib, so that figures are the same on every machine
        "font.size": sizes.text,
        "figure.titlesize": sizes.text + 1,
        "axes.titlesize": sizes.text,
        "axes.labelsize": sizes.text,
        "xtick.labelsize": sizes.small,
        "ytick.labelsize": sizes.small,
        "legend.fontsize": sizes.small,
        "legend.frameon": False,
        "axes.linewidth": 0.6,
        "axes.unicode_minus": False,  # so that a number can be copied
        "axes.titlepad": 4,
        "grid.linewidth": 0.4,
        "hatch.linewidth": 0.5,
        "lines.linewidth": 1.2,
        "xtick.major.width": 0.6,
        "ytick.major.width": 0.6,
        "xtick.major.size": 2.5,
        "ytick.major.size": 2.5,
        "xtick.minor.size": 1.5,
        "ytick.minor.size": 1.5,
        "svg.fonttype": "none",  # text stays text: it can be searched and edited
        "svg.hashsalt": "stlbench",
        "pdf.fonttype": 42,
    }


Words = ParamSpec("Words")
Drawn = TypeVar("Drawn")
Shown = TypeVar("Shown")


def styled(draw: Callable[Words, Drawn]) -> Callable[Words, Drawn]:
    """Give a function's figure this style; matplotlib reads most of it when an artist is made."""

    @wraps(draw)
    def drawing(*args: Words.args, **words: Words.kwargs) -> Drawn:
        import matplotlib as mpl

        with mpl.rc_context(rc()):
            return draw(*args, **words)

    return drawing


Colours = Mapping[str, str]  # method -> its colour, on every chart of a folder of results
SAFE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's palette for colour-blind readers, without its yellow, which is hard to see on white."""
_FURTHER = ("#8C6D31", "#C2185B", "#5E9C1F", "#6B6ECF", "#A55194", "#17A2A2", "#8F8F8F")
"""For as many more methods, and for terms."""
COLOURS = (*SAFE, *_FURTHER)  # of methods, and of nothing else
INK, TRACE, MARK, BOUNDS = "0.15", "0.3", "#A00000", "#6A3D9A"
"""Colours of no method: for the best possible, recorded traces, the step that decides, and a method's bounds."""
TIME = "cividis"  # colours of the time along a trace: from blue to yellow, so that no term's colour is among them
Line = Literal["-", "--", ":"]
LINES: tuple[Line, ...] = ("-", "--", ":")
GROUPS_PER_FIGURE = len(SAFE)  # in figures that distinguish them by colour
TERM_COLOURS = _FURTHER[:5]
HATCHES = ("", "///", "...", "xxx")


class GroupStyle(NamedTuple):
    label: str  # the method, with agent and budget if they differ, and how many seeds finished: "flag: 4 of 5 seeds"
    colour: str
    line: Line


class TermStyle(NamedTuple):
    colour: str
    hatch: str  # empty for the first terms; further terms have a colour and a hatch


def colours_of(groups: Sequence[Group]) -> Colours:
    """The colour of each method, given all groups of a folder. More methods than `COLOURS` share colours.

    Methods that learned come first, by name, then methods that were only planned for.
    """
    learned = {str(group.setting.method) for group in split(groups)[0]}
    planned = {str(group.setting.method) for group in groups} - learned
    return dict(zip([*sorted(learned), *sorted(planned)], cycle(COLOURS), strict=False))


def lines_of(colours: Iterable[str]) -> list[Line]:
    """For lines of these colours on one chart: lines of one colour differ in how they are drawn, first solid."""
    seen, result = Counter[str](), list[Line]()
    for colour in colours:
        result.append(LINES[seen[colour] % len(LINES)])
        seen[colour] += 1
    return result


def styles(groups: Sequence[Group], colours: Colours) -> list[GroupStyle]:
    """The styles of groups that one chart of their task shows; `colours` of their methods."""
    own = [colours[str(group.setting.method)] for group in groups]
    return [
        GroupStyle(f"{name}: {_standing(group)}", colour, line)
        for group, name, colour, line in zip(groups, names_by("method", groups), own, lines_of(own), strict=True)
    ]


def names_by(part: Literal["task", "method"], groups: Sequence[Group]) -> list[str]:
    """That part of each setting, with agent, budget and track, each where the groups differ in it."""
    further = [each for each in ("agent", "budget", "track") if len({getattr(g.setting, each) for g in groups}) > 1]
    return [", ".join(str(getattr(group.setting, each)) for each in (part, *further)) for group in groups]


def _standing(group: Group) -> str:
    """ "4 of 5 seeds, 1 timeout"; "intractable" if all seeds ended alike without a result."""
    statuses = {row.status for row in group.rows if row.measurement is None}
    if not group.done and len(statuses) == 1:
        return statuses.pop()
    ended = unfinished(group.rows)
    return f"{len(group.done)} of {len(group.rows)} seeds" + (f", {ended}" if ended else "")


def pages(shown: Sequence[Shown], size: int = GROUPS_PER_FIGURE) -> Iterator[tuple[str, Sequence[Shown]]]:
    """Pages of at most `size` each, about as many on each, after the endings of their files: "", "_2", "_3", ..."""
    count = math.ceil(len(shown) / size)
    ends = [round(i * len(shown) / count) for i in range(count + 1)] if count else []
    for i, (start, end) in enumerate(pairwise(ends)):
        yield f"_{i + 1}" if i else "", shown[start:end]


def term_style(i: int) -> TermStyle:
    """The style of term i of a task; the first 20 are all different."""
    return TermStyle(TERM_COLOURS[i % len(TERM_COLOURS)], HATCHES[i // len(TERM_COLOURS) % len(HATCHES)])
