"""What the cells of a study need, imported and loaded once: in a process from which those of the cells are forked.

Only plugins that come with stlbench are loaded: to import another may change what the cells of its rivals see. It is
imported in each cell that it belongs to.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress

import numpy as np

from stlbench.registry import plugins
from stlbench.rollout.environment import BatchEnvironment
from stlbench.study.cell import Cell
from stlbench.study.code_changes import changed
from stlbench.study.provenance import here
from stlbench.task import Task, build_agent, build_method


def examples(cells: Iterable[Cell]) -> tuple[Cell, ...]:
    """A few of the cells, with each task, method and agent at least once."""
    seen, chosen = set[tuple[str, str]](), list[Cell]()
    for cell in cells:
        if parts := set(_parts(cell).items()) - seen:
            seen |= parts
            chosen.append(cell)
    return tuple(chosen)


def _parts(cell: Cell) -> dict[str, str]:
    return {"tasks": str(cell.id.task), "methods": str(cell.id.method), "agents": str(cell.id.agent)}


def warm(cells: Sequence[Cell]) -> None:
    """Load what these cells need, as far as it comes with stlbench; what cannot be loaded is passed over."""
    here()
    for cell in cells:
        with suppress(Exception):
            changed(cell)  # reads its files, so that its own look at them finds them read
        if _is_own("tasks", cell.id.task.name):
            with suppress(Exception):
                _warm(cell.load_task(), cell)


def _warm(task: Task, cell: Cell) -> None:
    if _is_own("methods", cell.id.method.name):
        with suppress(Exception):  # a method that does not fit
            environment = BatchEnvironment(task, build_method(task, cell.id.method), 2, 0)
            environment.reset()
            environment.step(np.tile(environment.actions.low, (2, 1)))
    if _is_own("agents", cell.id.agent.name):
        build_agent(task, cell.id.agent).preload()


def _is_own(kind: str, name: str) -> bool:
    return plugins.find(kind, name).distribution == plugins.OWN
