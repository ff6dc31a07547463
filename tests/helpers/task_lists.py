"""Which of the tasks that come with stlbench are the paper's, and which come from the field."""

from __future__ import annotations

from stlbench.registry import plugins

TASKS = sorted(name for name, plugin in plugins.available("tasks").items() if plugin.distribution == plugins.OWN)
FIELD = ("cartpole-steady", "dwell", "either-or", "hopper", "lane", "lunar-lander", "patrol", "walker")
PAPER = [name for name in TASKS if name not in FIELD]
