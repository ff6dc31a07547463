"""Cells of plugins that give what the contract does not say: each reason names the plugin and the rule."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers import line_task

from stlbench.records.identity import CellId
from stlbench.study import trial
from stlbench.study.cell import Cell

METHOD = """
import numpy as np
from stlbench.contract import RewardMethod
class One(RewardMethod):
    {body}
"""
AGENT = """
import numpy as np
from stlbench.contract import Agent, Policy, StatePolicy
class Still(Policy):
    def act(self, observation): return {acted}
    def arrays(self): return {arrays}
class Planned(StatePolicy):
    def episode(self): return 7
class One(Agent):
    def train(self, training):
        environment = training.make({count})
        environment.reset()
        environment.step({action})
        training.report({reported}, {steps})
        return Still()
"""
RIGHT = {"acted": "np.zeros(len(observation), int)", "arrays": "None", "count": 2, "action": "np.zeros(2, int)"}
RIGHT |= {"reported": "Still()", "steps": 2}
ALONG = "def along(self, samples, action, t, memory): return {}"
TWO = ALONG.format("0, 0") + "\n    memory_size = 2\n    "
SHAPE = "the shape of its {} is {}, the contract says {}"
ARRAY = "the contract says an array of real numbers, float64"


@pytest.fixture
def reason(site: Any, tmp_path: Path) -> Callable[..., str]:
    """What the cell of a method, an agent and a system raises."""

    def of(method: str = ALONG.format("samples[1:, :, 0], memory"), system: str = "", **agent: Any) -> str:
        text = line_task.SYSTEM + "".join(f"    {line}\n" for line in system.splitlines())
        files = {"method.py": METHOD.format(body=method), "agent.py": AGENT.format(**(RIGHT | agent))}
        files |= {"__init__.py": "", "system.py": text, "task.yaml": line_task.text(agents={})}
        kinds = {"tasks": "system:Line", "methods": "method:One", "agents": "agent:One"}
        entries = "".join(f"[stlbench.{kind}]\nzz = zz_odd.{place}\n" for kind, place in kinds.items())
        site("zz-odd", entries, {f"zz_odd/{name}": each for name, each in files.items()})
        importlib.invalidate_caches()
        with pytest.raises(Exception, match=r"^(method|agent|task|the agent's|arrays of a policy|cost)") as caught:
            trial.run_cell(Cell(CellId.parse("zz/zz/zz/0/plain", "smoke"), 32 * "0", 60), tmp_path / "results")
        return str(caught.value)

    return of


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (ALONG.format("None"), "along gives NoneType, the contract says rewards and memory"),
        (ALONG.format("samples[1:, :, 0]"), "along gives float64, the contract says rewards and memory"),
        (ALONG.format("samples[1:, :, 0].tolist(), memory"), f"its rewards are list, {ARRAY}"),
        (ALONG.format("samples[1:, :, 0], None"), f"its memory are NoneType, {ARRAY}"),
        (ALONG.format("samples[1:, :, 0], np.zeros((2, 3))"), SHAPE.format("memory", (2, 3), (2, 0))),
        (TWO + "def initial_memory(self, s, t): return np.zeros((len(s), 5))", SHAPE.format("memory", (2, 5), (2, 2))),
        (TWO + "def inputs(self, memory): return None", f"its inputs are NoneType, {ARRAY}"),
    ],
)
def test_a_method(reason: Callable[..., str], body: str, said: str) -> None:
    assert reason(method=body) == f"method zz: {said}"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"count": "'x'"}, "agent zz makes an environment of 'x' copies, the contract says a whole number, at least 1"),
        ({"action": "[0, 0]"}, "the agent's actions are list, the contract says an array"),
        ({"reported": "None"}, "agent zz gives NoneType, the contract says a policy"),
        ({"steps": "'x'"}, "agent zz reports 'x' steps, the contract says a whole number"),
        ({"acted": "None"}, "the agent's actions are NoneType, the contract says an array"),
        ({"arrays": "7"}, "arrays of a policy gives int, the contract says arrays by name, or None"),
        ({"reported": "Planned()"}, "the agent's policy: episode gives int, the contract says a function"),
    ],
)
def test_an_agent(reason: Callable[..., str], changes: dict[str, Any], said: str) -> None:
    assert reason(**changes) == said


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("def step(self, state, action): return None", f"its states are NoneType, {ARRAY}"),
        ("def step(self, state, action): return state[:1]", SHAPE.format("states", (1, 1), (2, 1))),
        ("def signals(self, state): return None", f"its signals are NoneType, {ARRAY}"),
        ("def scaled_state(self, state): return state[:, 0]", SHAPE.format("features", (2,), (2, 1))),
        ("def initial_states(self, points): return None", "initial_states gives NoneType, the contract says an array"),
    ],
)
def test_a_task(reason: Callable[..., str], body: str, said: str) -> None:
    assert reason(system=body).startswith(f"task zz: {said}")
