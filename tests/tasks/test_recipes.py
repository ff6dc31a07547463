"""Each task comes with a recipe for every agent that fits its actions, and each recipe is one that the agent takes."""

from __future__ import annotations

import pytest

from stlbench import plugins, problem
from stlbench.choices import Choice
from stlbench.contract import ActionGrid

TASKS = sorted(name for name, plugin in plugins.available("tasks").items() if plugin.distribution == "stlbench")


@pytest.mark.parametrize("name", TASKS)
def test_recipes(name: str) -> None:
    task = problem.load(name)
    on_grids = {"dqn", "dqn-per-robot"} if task.file.robots else {"dqn", "sb3-dqn"}
    continuous = {"td3", "sb3-td3", "sb3-sac", "sb3-ppo"}
    assert set(task.file.agents) == (on_grids if isinstance(task.actions, ActionGrid) else continuous)
    for agent in task.file.agents:
        plugins.check("agents", Choice(agent), task.recipe(agent))
