"""Tasks: the task file, the system beside it, the initial states, and what is built for a task."""

from stlbench.task.build import build_agent, build_method, fitting_methods
from stlbench.task.task import Task, load_task

__all__ = ["Task", "build_agent", "build_method", "fitting_methods", "load_task"]
