"""Sequences of held actions, such as a suite's witnesses, as episodes."""

from __future__ import annotations

from stlbench.contract import Integers
from stlbench.rollout import referee
from stlbench.rollout.controller import Unpaid
from stlbench.rollout.referee import Episodes
from stlbench.task import Task


def replay(task: Task, indices: Integers) -> Episodes:
    """The episodes from the report's starts under actions of the grid, by index: (starts, decisions)."""
    begun, hold = task.starts.report_and_selection()[0], task.file.hold
    return referee.simulate(task, Unpaid(task.specification), lambda at: indices[:, int(at.t[0]) // hold], begun)
