"""A task comes with a recipe for every agent that fits its actions, or with none. Each recipe is one that the agent
takes.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers.task_lists import PAPER, TASKS, WITHOUT_RECIPES

from stlbench.contract import ActionGrid
from stlbench.registry import plugins
from stlbench.registry.choices import Choice
from stlbench.simulation.baselines import constants
from stlbench.study.cell import on_track, own_agent_on
from stlbench.study.study import Study
from stlbench.task import load_task
from stlbench.task.file import OPTIONAL


@pytest.mark.parametrize("name", WITHOUT_RECIPES)
def test_a_task_without_a_recipe_has_nothing_by_hand(name: str) -> None:
    file = load_task(name).file
    assert not {"agents", "rewarded", "nested", "training", "features"} & file.model_fields_set
    assert file.agents == {}


@pytest.mark.parametrize("name", [name for name in TASKS if name not in WITHOUT_RECIPES])
def test_recipes(name: str) -> None:
    task = load_task(name)
    on_grids = {"dqn", "dqn-per-robot"} if task.file.robots else {"dqn", "sb3-dqn"}
    continuous = {"td3", "sb3-td3", "sb3-sac", "sb3-ppo"}
    planned = {"planner", "best-possible"}
    assert set(task.file.agents) - planned == (on_grids if isinstance(task.actions, ActionGrid) else continuous)
    for agent in task.file.agents:
        plugins.check("agents", Choice(agent), task.recipe(agent))


def test_the_ablation_leaves_out_each_part_of_each_recipe_of_the_papers_tasks_once() -> None:
    study = Study.of({}, Path(__file__).parents[2] / "studies/ablation.yaml")
    files = {name: load_task(name).file for name in PAPER}
    parts = {f"{name}[without={part}]" for name, file in files.items() for part in OPTIONAL if file.has(part)}
    assert sorted(map(str, study.tasks)) == sorted(parts)
    assert (len(study.methods or ()), len(study.seeds or ())) == (3, 5)


def test_the_ablation_on_auto_leaves_out_each_part_that_the_rules_derive() -> None:
    study = Study.of({}, Path(__file__).parents[2] / "studies/auto-ablation.yaml")
    tasks = [task for task in map(load_task, PAPER) if not constants(task).trivial]
    derived = {task.name: on_track(task, Choice(own_agent_on(task, "auto")), "auto").file for task in tasks}
    optional = set(OPTIONAL) - {"hold"}  # which no rule derives
    parts = {f"{name}[without={part}]" for name, file in derived.items() for part in optional if file.has(part)}
    assert sorted(map(str, study.tasks)) == sorted(parts)
