"""Sequences of held actions, such as a suite's witnesses, as episodes."""

from __future__ import annotations

from stlbench.contract import Array, Integers
from stlbench.rollout import referee
from stlbench.rollout.controller import Unpaid
from stlbench.rollout.referee import Episodes
from stlbench.task import Task


def replay(task: Task, actions: Integers | Array, begun: Array | None = None) -> Episodes:
    """The episodes under these actions, one for each decision.

    Args:
        task: whose actions are held.
        actions: indices of the grid (starts, decisions), or vectors (starts, decisions, axes).
        begun: the starts (N, s); the report's where left out.
    """
    begun, hold = task.starts.report_and_selection()[0] if begun is None else begun, task.file.hold
    return referee.simulate(task, Unpaid(task.specification), lambda at: actions[:, int(at.t[0]) // hold], begun)
