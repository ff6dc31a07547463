"""causation: how far the newest sample causes a violation (Tang, Zhang, Zhang, An, arXiv 2510.07715, 2025)."""

from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from pydantic import Field

from stlbench import stl
from stlbench.contract import Array, Integers, RewardMethod, Specification, Unsuitable
from stlbench_methods.formula_parts import bounded_range, scaled


class Causation(RewardMethod):
    """The online violation causation distance where it is at most 0, else a bonus.

    For G[0,T] phi, phi a conjunction of F[0,w] psi, G[0,w] psi and psi, and for conjunctions of such formulas. The
    distance c of the newest sample is the least of

    - the greatest margin of psi over the last w + 1 samples, for each F[0,w] psi, once there are as many;
    - the margin of psi, for each psi and G[0,w] psi.

    Each counts as long as it is asked about a step of [0,T]. This is the closed form of the source's recursion on these
    formulas. Nothing counts after the last step: the bonus is paid there.

    The policy sees the margins of the last w + 1 samples for each F.

    Args:
        bonus: K, what a sample is paid that causes no violation, in the unit of the predicates. In the source 5 for
            Hopper and Walker2d, 1 for CartPole, 0.1 for PointGoal.

    Raises:
        Unsuitable: neither the formula nor the task's nested form is of that form.
    """

    def __init__(self, specification: Specification, *, bonus: Annotated[float, Field(gt=0)] = 1.0) -> None:
        super().__init__(specification)
        self._parts = _parts(specification)
        self._margins = [specification.margin(part.psi) for part in self._parts]
        ranges = [bounded_range(specification, part.psi, part) for part in self._parts]
        self._ranges = [ends for part, ends in zip(self._parts, ranges, strict=True) if part.width]
        self._bonus, self.floor = bonus, min(bonus, min(low for low, _ in ranges))
        self.scale = max(bonus, -self.floor)
        self.memory_size = sum(part.width + 1 for part in self._parts if part.width)

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        """The margins of copies of the first sample, which count for nothing before there are w + 1 samples."""
        each = zip(self._parts, self._margins, strict=True)
        windows = [np.repeat(h(signals)[:, None], part.width + 1, axis=1) for part, h in each if part.width]
        return np.concatenate([np.empty((len(signals), 0)), *windows], axis=1)

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        steps = t + np.arange(1, len(samples))[:, None]
        least, windows, at = np.full(steps.shape, np.inf), [np.empty((len(t), 0))], 0
        for part, h in zip(self._parts, self._margins, strict=True):
            value = h(samples[1:])
            if part.width:
                path = np.concatenate([memory[:, at + 1 : at + part.width + 1], value.T], axis=1)
                value = sliding_window_view(path, part.width + 1, axis=1).max(axis=-1).T
                windows.append(path[:, -part.width - 1 :])
                at += part.width + 1
            asked = (steps >= part.width) & (steps <= part.last + part.width)
            least = np.where(asked, np.minimum(least, value), least)
        return np.where(least <= 0, least, self._bonus), np.concatenate(windows, axis=1)

    def inputs(self, memory: Array) -> Array:
        if not self.memory_size:
            return memory
        counts = [part.width + 1 for part in self._parts if part.width]
        return scaled(memory, *np.repeat(np.array(self._ranges), counts, axis=0).T)

    def describe(self) -> Mapping[str, Any]:
        return {"parts": [f"{part} at steps 0 to {part.last}" for part in self._parts]}


class _Part(NamedTuple):
    """F[0,width] psi, or psi if the width is 0, at each of the steps 0 to `last`."""

    psi: stl.Formula
    width: int
    last: int

    def __str__(self) -> str:
        return str(stl.Eventually(0, self.width, self.psi) if self.width else self.psi)


def _parts(specification: Specification) -> list[_Part]:
    forms = [form for form in (specification.formula, specification.nested) if form is not None]
    for form in forms:
        conjuncts = form.args if isinstance(form, stl.And) else (form,)
        found = [part for conjunct in conjuncts for part in _of(conjunct)]
        if None not in found:
            return [part for part in found if part is not None]
    raise Unsuitable(
        f"causation: it takes G[0,T] phi, phi a conjunction of F[0,w] psi, G[0,w] psi and psi, not {forms[0]}; a task "
        "file may give such a form as `nested`"
    )


def _of(conjunct: stl.Formula) -> list[_Part | None]:
    """The parts of G[0,T] phi; None for a conjunct of another form."""
    if not (isinstance(conjunct, stl.Always) and conjunct.a == 0):
        return [None]
    phi, last = conjunct.arg, conjunct.b
    if not stl.is_temporal(phi):
        return [_Part(phi, 0, last)]
    found = list[_Part | None]()
    for arg in phi.args if isinstance(phi, stl.And) else (phi,):
        match arg:
            case stl.Eventually(0, width, psi) if not stl.is_temporal(psi):
                found.append(_Part(psi, width, last))
            case stl.Always(0, width, psi) if not stl.is_temporal(psi):
                found.append(_Part(psi, 0, last + width))
            case _:
                found.append(None if stl.is_temporal(arg) else _Part(arg, 0, last))
    return found
