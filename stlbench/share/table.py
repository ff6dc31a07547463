"""A user's own table of actions: what a network with other outputs than the task's grid means by each of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stlbench.contract import ActionGrid, Actions, Array
from stlbench.errors import UsageError, did_you_mean
from stlbench.rollout.faults import out_of_range
from stlbench.rollout.trace_table import read_table


@dataclass(frozen=True)
class ActionTable:
    """Actions by number. The simulator takes them as they are, on a grid of the task or beside it."""

    vectors: Array
    """(A, axes), in the task's units."""

    @property
    def numbers(self) -> ActionGrid:
        """The numbers of the actions, as a grid: what a policy chooses from."""
        return ActionGrid(("action",), (tuple(map(float, range(len(self.vectors)))),))

    def chosen(self, indices: Any) -> Array:
        """The actions (N, axes) of numbers (N,)."""
        vectors: Array = self.vectors[indices]
        return vectors


def read_actions(path: Path, actions: Actions) -> ActionTable:
    """A table of text: a column for each axis of the task's actions, a row for each action, in the network's order.

    Raises:
        UsageError: it cannot be read, has other columns, or an action that is beyond the ends of the task's.
    """
    table = read_table(path)
    for name in (*actions.names, *table.names):
        if name not in actions.names:
            raise UsageError(f"{path}: the task's actions have no '{name}'{did_you_mean(name, actions.names)}")
        if name not in table.names:
            raise UsageError(f"{path}: there is no column '{name}'; the task's actions have {', '.join(actions.names)}")
    vectors = np.column_stack([table.column(name) for name in actions.names])
    if wrong := out_of_range(actions, vectors):
        raise UsageError(f"{path}: {wrong}")
    return ActionTable(np.clip(vectors, actions.low, actions.high))
