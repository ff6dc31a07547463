"""Tasks: the task file, the dynamics, the starts, and the methods and agents that are built for a task."""

from stlbench.task.build import build_agent, build_method, fitting_methods
from stlbench.task.task import Task, load_task

__all__ = ["Task", "build_agent", "build_method", "fitting_methods", "load_task"]
