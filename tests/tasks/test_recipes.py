"""Each task comes with a recipe for every agent that fits its actions, and each recipe is one that the agent takes."""

from __future__ import annotations

import pytest

from stlbench.contract import ActionGrid
from stlbench.registry import plugins
from stlbench.registry.choices import Choice
from stlbench.task import load_task

TASKS = sorted(name for name, plugin in plugins.available("tasks").items() if plugin.distribution == plugins.OWN)


@pytest.mark.parametrize("name", TASKS)
def test_recipes(name: str) -> None:
    task = load_task(name)
    on_grids = {"dqn", "dqn-per-robot"} if task.file.robots else {"dqn", "sb3-dqn"}
    continuous = {"td3", "sb3-td3", "sb3-sac", "sb3-ppo"}
    planned = {"planner", "best-possible"}
    assert set(task.file.agents) - planned == (on_grids if isinstance(task.actions, ActionGrid) else continuous)
    for agent in task.file.agents:
        plugins.check("agents", Choice(agent), task.recipe(agent))
