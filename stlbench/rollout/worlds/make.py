"""The world of a task, whatever the task is."""

from __future__ import annotations

from stlbench.contract import GymTask, System, World
from stlbench.rollout.worlds.system_world import SystemWorld
from stlbench.task.task import Task


def make_world(task: Task, count: int, *, drawn: bool = False) -> World:
    """That many copies, none of them begun.

    Args:
        task: whose they are.
        count: how many.
        drawn: whether pictures of them are wanted, which an environment of Gymnasium has to know when it is made.
    """
    dynamics = task.dynamics
    if isinstance(dynamics, System):
        return SystemWorld(dynamics, count, engineered=task.file.features == "engineered")
    if isinstance(dynamics, GymTask):
        from stlbench.rollout.worlds.gym_world import GymWorld  # imports Gymnasium, which most tasks do without

        return GymWorld(dynamics, task.source, count, drawn=drawn)
    return dynamics.world(count)
