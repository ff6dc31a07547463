"""Upper bounds on what is possible on tasks of the suite, proven for the actions of the grid."""

from __future__ import annotations

from collections import defaultdict
from itertools import product

import numpy as np

from stlbench import stl
from stlbench.contract import ActionGrid, Array
from stlbench.task import Task
from stlbench.task.forms import Window, with_parts
from stlbench_tasks.suite.systems import Integrator, Pair, SuiteSystem

_LATTICE = (Integrator, Pair)
"""Systems whose points move by whole multiples of an axis' least velocity, one decision after another."""
_BOX = (-1.0, 7.0)
"""The range in which places of the lattice are tried: the room and a metre around it."""
_TOLERANCE, _NODES = 1e-3, 500


def upper_bound(task: Task, system: type[SuiteSystem]) -> float:
    """The mean over the report's starts of more robustness than any actions of the grid have.

    1. The margin of a part without temporal operators changes by at most the way of each point that it reads. So
       within t seconds it is at most its value at the start, plus the farthest way, and never more than its greatest
       value.
    2. Some systems reach places of a lattice alone. There it is at most the greatest value on the lattice.
    3. The formula, read on these bounds, bounds its robustness, as it falls with none of the margins.
    4. Parts that all have to hold at one step are at most as large as the greatest value of their least margin.
    """
    reach = Reach(task, system)
    traces = list[Array]()

    def part(window: Window) -> stl.Formula:
        traces.append(reach.most(window.psi))
        return stl.parse(f"p{len(traces)} >= 0")

    formula = with_parts(task.formula, part)
    names = [f"p{i + 1}" for i in range(len(traces))]
    robustness: Array = stl.robustness(formula, np.stack(traces, axis=-1), names)
    for psi, step in _at_once(task.formula):
        robustness = np.minimum(robustness, reach.most(psi)[:, step])
    return float(robustness.mean())


class Reach:
    """How large margins can be, step by step, from each start."""

    def __init__(self, task: Task, system: type[SuiteSystem]) -> None:
        self.task, self.system = task, system
        self.signals = task.system.signals(task.starts.report_and_selection()[0])
        self.way = way = system.about.farthest(task.file.sampling_time * np.arange(task.file.steps + 1))
        self.box = {name: (low - way[-1] - 1, high + way[-1] + 1) for name, (low, high) in task.file.box.items()}

    def most(self, psi: stl.Formula) -> Array:
        """(starts, steps + 1): more than the margin of a part without temporal operators can be."""
        read = set(stl.signals(psi))
        moving = [names for names in self.system.about.points if not read.isdisjoint(names)]
        highest = stl.bounds(psi, self.box, tolerance=_TOLERANCE, nodes=_NODES).high
        at_start = stl.margin(psi, self.task.signals)(self.signals)
        most = np.full((len(at_start), len(self.way)), highest)
        if read == set().union(*moving):
            # Margins in the room are distances: they grow by no more than the ways of the points that they read.
            most = np.minimum(most, at_start[:, None] + len(moving) * self.way)
            if self.system in _LATTICE and len(moving) == 1:
                self._on_lattice(psi, moving[0], most)
        most[:, 0] = at_start
        return most

    def _on_lattice(self, psi: stl.Formula, names: tuple[str, ...], most: Array) -> None:
        """Lower `most` to what places of the lattice have: those of whole decisions, and of steps in between."""
        actions, file = self.task.actions, self.task.file
        assert isinstance(actions, ActionGrid)
        pitch = np.diff(np.unique(actions.vectors[:, 0])).min() * file.sampling_time
        beyond = max(stl.bounds(psi, box, tolerance=_TOLERANCE, nodes=_NODES).high for box in self._beyond(names))
        columns = [self.task.signals.index(name) for name in names]
        boundary = np.arange(len(self.way)) % file.hold == 0
        for steps, spacing in ((boundary, file.hold * pitch), (~boundary, pitch)):
            count = int(np.ceil((_BOX[1] - _BOX[0]) / spacing)) + 1
            offsets = np.array(list(product(np.arange(count) * spacing, repeat=len(names))))
            greatest = []
            for start in self.signals[:, columns]:
                places = _BOX[0] + (start - _BOX[0]) % spacing + offsets
                greatest.append(stl.margin(psi, names)(places).max())
            bound = np.maximum(greatest, beyond) + 1e-9  # places on the lattice are rounded
            most[:, steps] = np.minimum(most[:, steps], bound[:, None])

    def _beyond(self, names: tuple[str, ...]) -> list[dict[str, tuple[float, float]]]:
        """Boxes that hold all places outside of the one where the lattice is tried."""
        return [
            {**self.box, name: side}
            for name in names
            for side in ((self.box[name][0], _BOX[0]), (_BOX[1], self.box[name][1]))
        ]


def _at_once(formula: stl.Formula) -> list[tuple[stl.Formula, int]]:
    """Conjunctions of parts that have to hold at one step, each with its first such step."""
    held = defaultdict[int, list[stl.Formula]](list)
    for term in formula.args if isinstance(formula, stl.And) else (formula,):
        if isinstance(term, stl.Always) and not stl.is_temporal(term.arg):
            for step in range(term.a, term.b + 1):
                held[step].append(term.arg)
    first = dict[tuple[stl.Formula, ...], int]()
    for step, parts in sorted(held.items()):
        if len(parts) > 1:
            first.setdefault(tuple(parts), step)
    return [(stl.And(parts), step) for parts, step in first.items()]
