"""The best actions of the grid by mixed-integer programming, for the systems of the suite that are linear.

The encoding is that of stlpy (Kurtz and Lin, 2022): the robustness of each part at each step is a variable, at most
what its operands have; of an alternative, a binary variable says which operand counts. The actions are whole numbers of
the grid's pitch. A disc is the polygon around it, so what HiGHS proves is an upper bound. Its actions are a witness.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from programme import Programme

from stlbench import stl
from stlbench.contract import ActionGrid, Array
from stlbench.task import Task

DIRECTIONS = 24
"""Sides of a polygon."""
_DISC = re.compile(r"norm\((\w+) - ([\d.]+), (\w+) - ([\d.]+)\) <= ([\d.]+)")
_FAR = 30.0
"""More than two margins in the room differ by."""
_GAP = 1e-3
"""A gap at which the search ends: the bound that is proven is then at most so much too high, relative to it."""

Most = Callable[[stl.Formula], Array]
"""Gives (starts, steps + 1): more than the margin of a part without temporal operators can be."""


class Optimum(NamedTuple):
    """The result of the search from one start."""

    bound: float
    """More than the robustness can be."""
    actions: Array | None
    """(decisions, axes): the best that were found; None if there are none."""


def optimum(task: Task, place: int, most: Most, seconds: float) -> Optimum:
    """The best from one of the report's starts, of a system that is linear in state and action.

    Raises `ValueError` for a formula with U or the negation of a temporal part.
    """
    program = _Program(task, place, most)
    return program.solved(program.part(task.formula, 0), seconds)


class _Program:
    """Variables: the actions of each decision, then robustness of parts, and choices."""

    def __init__(self, task: Task, place: int, most: Most) -> None:
        assert isinstance(task.actions, ActionGrid)
        self._most, self._place, self._names = most, place, task.signals
        axes, self._decisions = task.actions.axes, task.file.decisions
        self._least = np.array(task.actions.low)
        self._pitch = np.array([axis[1] - axis[0] for axis in axes])
        self._programme = Programme()
        for axis in axes * self._decisions:
            self._programme.variable(0, len(axis) - 1, whole=True)
        self._places = _places(task, task.starts.report_and_selection()[0][place], self._least, self._pitch)
        self._known: dict[tuple[stl.Formula, int], int] = {}

    def part(self, formula: stl.Formula, t: int) -> int:
        """The variable that is at most the robustness of a part at step t."""
        if (formula, t) not in self._known:
            self._known[formula, t] = self._programme.variable(-_FAR, _FAR)
            self._limit(self._known[formula, t], formula, t)
        return self._known[formula, t]

    def _limit(self, own: int, formula: stl.Formula, t: int) -> None:
        match formula:
            case stl.And(args=args):
                self._all(own, ((arg, t) for arg in args))
            case stl.Or(args=args):
                self._any(own, [(arg, t) for arg in args])
            case stl.Always(a=a, b=b, arg=arg):
                self._all(own, ((arg, t + step) for step in range(a, b + 1)))
            case stl.Eventually(a=a, b=b, arg=arg):
                self._any(own, [(arg, t + step) for step in range(a, b + 1)])
            case _ if (disc := _DISC.fullmatch(str(formula))) is not None:
                self._disc(own, disc, t)
            case _ if not stl.is_temporal(formula):
                self._programme.high[own] = float(self._most(formula)[self._place, t])
            case _:
                raise ValueError(f"no linear program for {formula}")

    def _all(self, own: int, parts: Iterable[tuple[stl.Formula, int]]) -> None:
        for formula, t in parts:
            self._programme.require({own: 1.0, self.part(formula, t): -1.0}, -np.inf, 0.0)

    def _any(self, own: int, parts: list[tuple[stl.Formula, int]]) -> None:
        chosen = [self._programme.variable(0, 1, whole=True) for _ in parts]
        for choice, (formula, t) in zip(chosen, parts, strict=True):
            self._programme.require({own: 1.0, self.part(formula, t): -1.0, choice: 2 * _FAR}, -np.inf, 2 * _FAR)
        self._programme.require(dict.fromkeys(chosen, 1.0), 1.0)

    def _disc(self, own: int, disc: re.Match[str], t: int) -> None:
        """radius - n (p - centre) for the outward normal n of each side; p is linear in the actions.

        The norm of p - centre is no less than any n (p - centre). So the polygon lies around the disc, and can only
        raise the bound.
        """
        names, centre, radius = disc.group(1, 3), [float(each) for each in disc.group(2, 4)], float(disc[5])
        constant, slope = self._places
        columns = [self._names.index(name) for name in names]
        for angle in 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
            normal = np.array([np.cos(angle), np.sin(angle)])
            weights = normal @ slope[t][columns]
            row = {int(i): float(weights[i]) for i in np.flatnonzero(weights)}
            most = radius - float(normal @ (constant[t][columns] - centre))
            self._programme.require(row | {own: 1.0}, -np.inf, most)

    def solved(self, root: int, seconds: float) -> Optimum:
        """Maximise a variable for at most so many seconds."""
        found = self._programme.maximise(root, time_limit=seconds, mip_rel_gap=_GAP)
        bound = self._programme.high[root] if found.mip_dual_bound is None else -float(found.mip_dual_bound)
        if found.x is None:
            return Optimum(bound, None)
        whole = np.round(found.x[: self._decisions * len(self._pitch)]).reshape(self._decisions, -1)
        return Optimum(bound, self._least + self._pitch * whole)


def _places(task: Task, start: Array, least: Array, pitch: Array) -> tuple[Array, Array]:
    """The signals by the least actions (steps + 1, k), and what each pitch adds to them (steps + 1, k, actions)."""
    file, axes = task.file, len(pitch)
    actions = file.decisions * axes
    more = np.concatenate([np.zeros((1, actions)), np.eye(actions) * np.tile(pitch, file.decisions)])
    state, traces = np.tile(start, (actions + 1, 1)), list[Array]()
    for t in range(file.steps + 1):
        traces.append(task.system.signals(state))
        if t < file.steps:
            first = t // file.hold * axes
            state = task.system.step(state, least + more[:, first : first + axes])
    trace = np.stack(traces)
    return trace[:, 0], (trace[:, 1:] - trace[:, :1]).transpose(0, 2, 1)
