"""Where the terms of a task's formula hold, for pictures of some of its signals."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Truth, Unsuitable
from stlbench.stl import Formula, Term
from stlbench.task.task import Task

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
    others = [name for name in task.signals if name in read and name not in names]
    if len(others) > _MOST_OTHERS or not set(read) & set(names):
        return None
    few = min(_MOST_VALUES, (_SAMPLES / math.prod(map(len, axes))) ** (1 / max(1, len(others))))
    count = int(few) // 2 * 2 + 1  # with the middle of the range among them
    values = []
    for name, low, high in zip(task.signals, specification.low, specification.high, strict=True):
        if name in names:
            values.append(axes[list(names).index(name)])
        else:
            values.append(np.linspace(low, high, count) if name in others else np.array([low]))
    samples = np.stack(np.meshgrid(*values, indexing="ij"), axis=-1)
    left_out = tuple(i for i, name in enumerate(task.signals) if name not in names)
    margin = specification.margin(psi)(samples).max(axis=left_out)
    truth: Truth = np.asarray(specification.holds(psi)(samples).any(axis=left_out))
    if [name for name in task.signals if name in names] != list(names):
        margin, truth = margin.T, truth.T
    return margin, truth
