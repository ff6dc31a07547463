"""Every installed task keeps the contract, and the checks notice what does not."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.line_task import text
from helpers.walk_task import walk_text

from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.testing import Rules, check_task

TASKS = plugins.available("tasks")


DEAR = ("lane", "fetch-avoid", "fetch-reach", "ball-in-cup")
"""Tasks whose check takes more than ten seconds."""


@pytest.mark.parametrize("task", [pytest.param(task, marks=[pytest.mark.slow] * (task in DEAR)) for task in TASKS])
def test_every_installed_task(task: str) -> None:
    check_task(task)


SYSTEM = """
import numpy as np
from stlbench.contract import System
class Line(System):
    state = ("x",)
    def step(self, state, action): return {step}
    def signals(self, state): return {signals}
    def features(self, state, t): return {features}
    def scaled_state(self, state): return {scaled_state}
    def changed(self, state): state += 1; return state
    def initial_states(self, points): return {initial_states}
    def controller(self, state, t): return {controller}
"""
SOUND = {
    "step": "state + self.dt * action",
    "signals": "state",
    "features": "state",
    "scaled_state": "state / 10",
    "initial_states": "points",
    "controller": "-state",
}


@pytest.fixture
def made(site: Callable[..., Path]) -> Callable[..., str]:
    """A function that installs a task: with parts of its system and entries of its file changed; its name."""

    def install(parts: dict[str, str] | None = None, **changes: Any) -> str:
        files = {
            "zz_conform/__init__.py": "",
            "zz_conform/system.py": SYSTEM.format(**(SOUND | (parts or {}))),
            "zz_conform/task.yaml": text(**changes),
        }
        site("zz-conform", "[stlbench.tasks]\nzz-conform = zz_conform.system:Line\n", files)
        return "zz-conform"

    return install


@pytest.mark.parametrize(
    ("parts", "changes", "rule"),
    [
        ({"step": "np.hstack([state, state])"}, {}, r"step has shape \(8, 1\); got \(8, 2\)"),
        ({"step": "state / 0"}, {}, "step is finite"),
        ({"step": "self.changed(state)"}, {}, "step leaves its arguments alone"),
        ({"step": "state + np.random.normal()"}, {}, "step is pure"),
        ({"step": "state - state.mean()"}, {}, "step of a batch is that of its rows"),
        ({"features": "100 * state"}, {}, r"features are about in \[-1, 1\]"),
        ({"features": "state[:, 0]"}, {}, r"features has shape"),
        ({"scaled_state": "100 * state"}, {}, r"the scaled state is about in \[-1, 1\]"),
        ({"scaled_state": "state[:, 0]"}, {}, r"scaled_state has shape"),
        ({"scaled_state": "state - state.mean()"}, {}, "scaled_state of a batch is that of its rows"),
        ({}, {"initial": {"box": {"x": [10.5, 11]}}}, "initial states lie in the signals' ranges"),
        ({"initial_states": "points[:, 0]"}, {}, r"initial_states has shape \(8, 1\); got \(8,\)"),
        ({"initial_states": "points + np.nan"}, {}, "initial_states is finite"),
        ({"initial_states": "points - points.mean()"}, {}, "initial_states of a batch is that of its rows"),
        ({"controller": "np.zeros((len(state), 2))"}, {}, r"controller has shape \(8, 1\); got \(8, 2\)"),
        ({"controller": "state + np.nan"}, {}, "controller is finite"),
        ({"controller": "self.changed(state)"}, {}, "controller leaves its arguments alone"),
        ({"controller": "-state if t[0] == 0 else None"}, {}, "a controller always has an action; got None"),
        ({"controller": "np.ones_like(state)"}, {}, "the controller satisfies the formula from some starts; got rob"),
        ({}, {"nested": "G[0,2] G[0,2] (x <= 0.9)"}, "the nested form has the formula's robustness"),
        ({}, {"schedule": "G[0,0] (x <= 9)", "rewarded": None}, "what satisfies the schedule satisfies the formula"),
        ({}, {"schedule": "G[0,4] (x <= -9)", "rewarded": "G[0,4] (x <= 1)"}, "the rewarded form is satisfied when"),
    ],
)
@pytest.mark.filterwarnings("ignore:(divide by zero|invalid value):RuntimeWarning")
def test_a_task_that_breaks_a_rule_is_told_which(
    made: Callable[..., str], parts: dict[str, str], changes: dict[str, Any], rule: str
) -> None:
    with pytest.raises(AssertionError, match=f"^rule broken: {rule}"):
        check_task(made(parts, **changes))


@pytest.mark.parametrize(
    ("stated", "rule"),
    [
        ({"satisfied": 0.5, "action": [-1.0]}, r"baselines\.constant is what its action gets; .*: 0\.5; got 1"),
        ({"satisfied": 1, "action": [-1.0, 0.0]}, r"baselines\.constant\.action has 1 numbers; got \(-1\.0, 0\.0\)"),
    ],
)
def test_stated_baselines_have_to_be_those_that_are_measured(
    made: Callable[..., str], stated: dict[str, Any], rule: str
) -> None:
    zero = {"robustness": 1, "satisfied": 1}
    baselines = {"zero": zero, "constant": stated | {"robustness": 1}, "random": zero}
    with pytest.raises(AssertionError, match=f"^rule broken: {rule}"):
        check_task(made(baselines=baselines))


def test_all_recipes_that_their_agents_do_not_understand_are_named(made: Callable[..., str]) -> None:
    agents = {"dqn": {"gama": 1, "head": "no"}, "dnq": {}, "td3": {"gamma": "x"}}
    with pytest.raises(UsageError) as caught:
        check_task(made(agents=agents))
    head, first, second, third = str(caught.value).splitlines()
    assert head == "task zz-conform: recipes have errors:"
    assert first.startswith("  agents.dqn: no parameter 'gama'; did you mean 'gamma'?; head should be ")
    assert second == "  agents.dnq: no agent 'dnq'; did you mean 'dqn'?"
    assert third == "  agents.td3: gamma should be a number, got 'x' in the recipe"


QUITTER = """
import gymnasium, numpy as np
class Quitter(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(-1, 1, (1,))
    action_space = gymnasium.spaces.Discrete(2)
    def reset(self, *, seed=None, options=None): return np.zeros(1, np.float32), {{}}
    def step(self, action): return np.zeros(1, np.float32), 0.0, {ends}, False, {{}}
gymnasium.register("Quitter{ends}-v0", Quitter)
"""


@pytest.mark.parametrize(
    ("ends", "rule", "satisfy"), [("True", "hold", 4), ("True", "violated", 0), ("False", "hold", None)]
)
def test_who_checks_is_warned_of_early_ends(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, ends: str, rule: str, satisfy: int | None
) -> None:
    """An environment that ends at its first step satisfies `G x <= .5` by standing still."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, f"zz_quitter_{ends}", raising=False)
    (tmp_path / f"zz_quitter_{ends}.py").write_text(QUITTER.format(ends=ends))
    folder = tmp_path / f"quit-{ends.lower()}-{rule}"
    folder.mkdir()
    environment = {"id": f"zz_quitter_{ends}:Quitter{ends}-v0", "names": ["x"]}
    changes = {"environment": environment, "terminated": rule, "formula": "G[0,4] x <= 0.5"}
    (folder / "task.yaml").write_text(walk_text(**changes))
    rules = Rules()
    check_task(str(folder), rules)
    warning = (
        "4 of 4 episodes of random actions end before step 4, the formula's horizon; "
        f"by `terminated: {rule}` {satisfy} of these satisfy the formula"
    )
    assert [line for line in rules.warnings if "trivial" not in line] == ([] if satisfy is None else [warning])


LIAR = """
import gymnasium, numpy as np
class Liar(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(-1, 1, (3,))
    action_space = gymnasium.spaces.Discrete(2)
    def seen(self): return np.array([self.t / 2, 0, 1 + self.t], np.float32)
    def reset(self, *, seed=None, options=None):
        self.t = 0
        return self.seen(), {}
    def step(self, action):
        self.t += 1
        return self.seen(), 0.0, False, False, {}
gymnasium.register("Liar-v0", Liar)
"""


def test_who_checks_is_warned_of_observations_outside_their_space(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The first entry leaves at step 3 and the last at step 1. A scale takes the place of the ends."""
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "zz_liar.py").write_text(LIAR)
    said = "the environment returned an observation outside its space at step {} of copy 0: {}, outside -1 to 1; "
    remedy = "`environment.scale` takes the place of these ends, and ranges should reach what signals take"
    both = [said.format(1, "'z' is 2"), said.format(3, "'x' is 1.5")]
    for name, scale, expected in (("liar", {}, both), ("mended", {"x": 4, "z": 8}, [])):
        folder, rules = tmp_path / name, Rules()
        folder.mkdir()
        environment = {"id": "zz_liar:Liar-v0", "names": ["x", "y", "z"], "scale": scale}
        (folder / "task.yaml").write_text(walk_text(environment=environment, steps=4))
        check_task(str(folder), rules)
        assert [line for line in rules.warnings if "outside" in line] == [line + remedy for line in expected]


def test_the_own_agent_of_a_task_has_to_be_able_to_act(made: Callable[..., str]) -> None:
    """`dqn` chooses from a grid; here the actions are continuous."""
    continuous, rules = {"v": {"low": -1, "high": 1}}, Rules()
    check_task(made(agents={"td3": {}}, actions=continuous), rules)
    assert "the task's own agent, td3, can act and train on it" in rules.kept
    wrong = "the task's own agent, dqn, can act .*are continuous, and this agent chooses from a grid"
    with pytest.raises(AssertionError, match=f"^rule broken: {wrong}"):
        check_task(made(agents={"dqn": {}, "td3": {}}, actions=continuous))
