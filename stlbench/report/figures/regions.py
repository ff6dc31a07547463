"""Where and when the parts of a task's formula hold, for pictures of its signals."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.patches import Rectangle

from stlbench import stl
from stlbench.contract import Array, Truth, Unsuitable
from stlbench.report.figures.layout import REGION_ALPHA
from stlbench.report.figures.palette import term_style
from stlbench.report.figures.units import time_label
from stlbench.stl import Always, And, Eventually, Formula, Or, Release, Term, Until
from stlbench.task.task import Task


class Part(NamedTuple):
    """A part of a formula without temporal operators, as large as there is."""

    psi: Formula
    start: int
    """The first step at which it can be read."""
    end: int
    """The last."""
    operators: tuple[str, ...]
    """Those that it stands in, from outside: G[0,900], F[0,99]."""

    def __str__(self) -> str:
        return " ".join([*self.operators, str(self.psi)])


def parts(task: Task) -> tuple[Part, ...]:
    """The parts of the task's own formula, in their order; of one in the fragment of eq. 2, one per term.

    Negations and implications of temporal formulas are read with their negations inside.
    """
    return tuple(_parts(Part(task.formula, 0, 0, ())))


def _parts(within: Part) -> Iterator[Part]:
    formula = within.psi
    if not stl.is_temporal(formula):
        yield within
        return
    match formula:
        case And(args) | Or(args):
            for arg in args:
                yield from _parts(within._replace(psi=arg))
        case Always(a, b, arg) | Eventually(a, b, arg):
            yield from _parts(_inside(within, f"{formula.letter}[{a},{b}]", arg, a, b))
        case Until(a, b, left, right):
            yield from _parts(_inside(within, f"until U[{a},{b}]", left, 0, b))
            yield from _parts(_inside(within, f"U[{a},{b}]", right, a, b))
        case Release(a, b, left, right):
            yield from _parts(_inside(within, f"releases R[{a},{b}]", left, 0, b))
            yield from _parts(_inside(within, f"R[{a},{b}]", right, a, b))
        case _ if (pushed := stl.negations_inside(formula)) != formula:
            yield from _parts(within._replace(psi=pushed))
        case _:  # of the past, which has no steps of its own
            return


def _inside(within: Part, operator: str, arg: Formula, a: int, b: int) -> Part:
    return Part(arg, within.start + a, within.end + b, (*within.operators, operator))


_MOST_OTHERS = 4
"""Signals of a term that a picture may leave out."""
_SAMPLES, _MOST_VALUES = 2_000_000, 801
"""Points that are looked at for a picture, about, and values of each signal that it leaves out, at most."""


def terms(task: Task) -> tuple[Term, ...]:
    """The terms of the task's own formula, which the referee scores; none where it is outside the fragment of eq. 2."""
    try:
        return stl.fragment(task.formula)
    except stl.FragmentError:
        return ()


def rewarded_terms(task: Task) -> tuple[Term, ...]:
    """The terms that reward methods see: of the task file's `rewarded` form where it has one."""
    try:
        return task.specification.terms
    except Unsuitable:
        return ()


def heading(term: Term) -> str:
    """The term's operators, which name it in a picture: G[900,1300] or F[0,600] G[0,200]."""
    if term.kind == "FG":
        return f"F[{term.a},{term.c1}] G[{term.c2},{term.b}]"
    return f"{term.kind}[{term.a},{term.b}]"


def region(task: Task, psi: Formula, axes: Sequence[Array], names: Sequence[str]) -> tuple[Array, Truth] | None:
    """The margin of `psi` over a grid of some signals, and where it holds.

    Further signals that psi reads take what values in their ranges are best, of a few: a region in the plane is the
    shadow of that in space.

    Args:
        task: gives the signals and their ranges.
        psi: without temporal operators.
        axes: the grid's values, (p,) for each of the names.
        names: one signal or two.

    Returns:
        Margin and truth, both (p_1, p_2) or (p_1,). None where psi reads none of these signals, or more than four
        others, which are too many to search.
    """
    read, specification = stl.signals(psi), task.specification
    hidden = [name for name in task.signals if name in read and name not in names]
    if len(hidden) > _MOST_OTHERS or not set(read) & set(names):
        return None
    few = min(_MOST_VALUES, (_SAMPLES / math.prod(map(len, axes))) ** (1 / max(1, len(hidden))))
    count = int(few) // 2 * 2 + 1  # with the middle of the range among them
    values = []
    for name, low, high in zip(task.signals, specification.low, specification.high, strict=True):
        if name in names:
            values.append(axes[list(names).index(name)])
        else:
            values.append(np.linspace(low, high, count) if name in hidden else np.array([low]))
    samples = np.stack(np.meshgrid(*values, indexing="ij"), axis=-1)
    left_out = tuple(i for i, name in enumerate(task.signals) if name not in names)
    margin = specification.margin(psi)(samples).max(axis=left_out)
    truth: Truth = np.asarray(specification.holds(psi)(samples).any(axis=left_out))
    if [name for name in task.signals if name in names] != list(names):
        margin, truth = margin.T, truth.T
    return margin, truth


READ = "0.92"
"""The grey of the steps at which a part of the formula is read."""


class Read(NamedTuple):
    """That a part of the formula reads a signal."""

    row: int
    """Which signal."""
    place: int
    """Which part."""
    part: Part
    ranges: list[tuple[float, float]]
    """Values of the signal with which the part can hold."""


def readings(task: Task) -> Iterator[Read]:
    """Which signals the parts read, as far as that can be drawn."""
    for row, (name, signal) in enumerate(task.file.signals.items()):
        grid = np.linspace(signal.low, signal.high, 1001)
        for i, part in enumerate(parts(task)):
            shadow = region(task, part.psi, (grid,), (name,)) if name in stl.signals(part.psi) else None
            if shadow is not None:
                yield Read(row, i, part, [(float(grid[first]), float(grid[last])) for first, last in _runs(shadow[1])])


def signals_in_time(rows: Sequence[Axes], task: Task) -> list[int]:
    """Lay out one row per signal: when each part of the formula is read, and with which values it can hold then.

    Returns:
        Indices of the parts that have a region in some row.
    """
    drawn = set()
    for row, i, part, ranges in readings(task):
        drawn.add(i)
        rows[row].axvspan(part.start, part.end, color=READ, linewidth=0, zorder=0)
        colour, hatch = term_style(i)
        for low, high in ranges:
            corner, size = (part.start, low), (part.end - part.start, high - low)
            fill = to_rgba(colour, 2 * REGION_ALPHA)
            rows[row].add_patch(Rectangle(corner, *size, facecolor=fill, edgecolor=colour, hatch=hatch, zorder=1))
    for axes in rows:
        axes.set_xlim(0, task.file.steps)
        axes.grid(alpha=0.25)
    rows[-1].set_xlabel(time_label(task))
    return sorted(drawn)


def _runs(truth: Truth) -> list[tuple[int, int]]:
    """First and last index of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], truth, [False]]).astype(np.int8)))
    return [(int(first), int(last) - 1) for first, last in edges.reshape(-1, 2)]
