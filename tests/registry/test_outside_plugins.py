"""The harness knows no agent and no method by name: those from outside have what those of stlbench have."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stlbench.contract import ActionBox, ActionGrid, Array, Integers, RewardMethod
from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.registry.choices import Choice
from stlbench.solver.contestants import contestants
from stlbench.study.cell import on_track
from stlbench.study.plan import plan_cells
from stlbench.task import build_method, load_task
from stlbench.task.build import aim_of, in_turn
from stlbench.task.task import agent_for, agents_for

HARNESS = Path(plugins.__file__).parents[1]
EXAMPLES = {("cli/run.py", "funnel,flag")}
"""What `stlbench run` compares where a user names nothing."""
WORDS = {"machine"}
"""Names that are words too: reports say on which machine."""
AGENT = """
from stlbench.contract import Agent
class Own(Agent):
    recipe = {recipe}
    preference = {{"grid": 1}}
    def __init__(self, *, units: int = 3, gamma: float = 0.5) -> None: ...
    def train(self, training): ...
class Made(Own): ...
"""
GRID, BOX = ActionGrid(("u",), ((0.0, 1.0),)), ActionBox(("u",), (-1.0,), (1.0,))


def literals(tree: ast.Module) -> Iterator[str]:
    """The texts of a module but for those that stand alone, as docstrings do."""
    alone = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in alone:
            yield node.value


def named(text: str, names: set[str]) -> bool:
    """Whether a text is the name of a plugin, with or without parameters, or a list with one."""
    return not names.isdisjoint(re.sub(r"\[.*?\]", "", text).split(","))


def test_no_module_of_the_harness_names_an_agent_or_a_method() -> None:
    own = {name for kind in ("agents", "methods") for name, each in plugins.available(kind).items() if each.is_own}
    assert named("raw,funnel[ginf=0.02]", own)
    assert not named("as in funnel or raw", own)
    found = {
        (path.relative_to(HARNESS).as_posix(), text)
        for path in HARNESS.rglob("*.py")
        for text in literals(ast.parse(path.read_text(encoding="utf-8")))
        if named(text, own - WORDS)
    }
    assert found == EXAMPLES


@pytest.fixture
def installed(site: Callable[..., Path]) -> Callable[[str], None]:
    """Installs two agents from outside, of which one is made of the other."""

    def install(recipe: str) -> None:
        entries = "[stlbench.agents]\nzz-own = zz_lab.agent:Own\nzz-made = zz_lab.agent:Made\n"
        site("acme-lab", entries, {"zz_lab/__init__.py": "", "zz_lab/agent.py": AGENT.format(recipe=recipe)})

    return install


def test_an_agent_from_outside_has_its_recipe_on_auto(installed: Callable[[str], None]) -> None:
    installed("{'units': 9, 'gamma': 0.3}")
    task = load_task("overlap")
    assert on_track(task, Choice("zz-own"), "auto").recipe("zz-own") == {"units": 9, "gamma": 0.5}  # 1 - 10 / 20
    assert on_track(task, Choice("zz-made"), "auto").recipe("zz-made") == {"units": 9, "gamma": 0.5}
    assert on_track(task, Choice("zz-own"), "plain").recipe("zz-own") == {}


def test_an_agent_from_outside_races_and_takes_no_task_over(installed: Callable[[str], None]) -> None:
    installed("{}")
    assert list(agents_for(GRID)) == ["dqn", "zz-own", "sb3-dqn", "cma-es"]
    assert list(agents_for(BOX)) == ["td3", "sb3-sac", "cma-es"]
    assert agent_for(GRID) == "dqn"
    last = contestants(load_task("overlap"), 60)[-1]
    assert (last.method, last.agent) == ("funnel", "zz-own")


def test_without_any_agent_that_can_be_loaded_the_reason_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plugins, "available", lambda kind: {})
    with pytest.raises(UsageError, match="no agent of stlbench for actions of kind box can be loaded"):
        agent_for(BOX)


@pytest.mark.parametrize("recipe", ["3", "{'units': {1, 2}}"])
def test_a_recipe_that_is_none_is_said_in_a_line(installed: Callable[[str], None], recipe: str) -> None:
    installed(recipe)
    with pytest.raises(plugins.PluginError, match=r"^agent 'zz-own' of acme-lab .*: its recipe should have parameters"):
        plan_cells([Choice("overlap")], [Choice("raw")], [Choice("zz-own")], [0], "smoke", "auto")


def test_a_method_from_outside_has_its_place_and_one_made_of_another_has_none() -> None:
    class First(RewardMethod):
        preference = {"other": 1}  # noqa: RUF012

        def arrival(self, signals: Array, t: Integers) -> Array:
            return np.zeros(t.shape)

    task = load_task("overlap")
    fitting: dict[str, Any] = {name: build_method(task, name) for name in ("cfer", "flag", "raw", "funnel")}
    fitting |= {"zz-made": type("Made", (First,), {})(task.specification), "zz-first": First(task.specification)}
    assert in_turn(fitting, aim_of(task.formula)) == ("funnel", "zz-first", "raw", "zz-made", "cfer", "flag")
