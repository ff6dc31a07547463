"""What is compiled once: each agent says what is missing, until this machine has compiled it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from stlbench.contract import Agent, compiled
from stlbench_agents import q_learner, td3_learner
from stlbench_agents.dqn import DQN, DQNPerRobot
from stlbench_agents.td3 import TD3


@pytest.fixture
def empty(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A machine that has compiled nothing: only the notes of it are elsewhere, so that the test compiles nothing."""
    assert {q_learner, td3_learner} <= {*sys.modules.values()}  # before, with the folder that has their code
    (tmp_path / "new").mkdir()
    monkeypatch.setattr(compiled, "folder", lambda package: tmp_path / "new")
    return tmp_path / "new"


@pytest.mark.parametrize(
    ("agent", "same", "other"),
    [
        (DQN(), DQN(net_arch=(7,), double=False), DQN(head="additive")),
        (DQN(head="additive"), DQNPerRobot(head="additive"), TD3()),
        (TD3(), TD3(net_arch=(5, 5, 5)), DQN()),
    ],
)
def test_what_is_compiled_is_not_compiled_again(empty: Path, agent: Agent, same: Agent, other: Agent) -> None:
    work = agent.uncompiled()
    assert work is not None
    assert same.uncompiled() is not None
    work()
    assert agent.uncompiled() is None
    assert same.uncompiled() is None
    assert other.uncompiled() is not None
    assert len({path.name for path in empty.iterdir()} - {"llvm-kernels"}) == 1


ONCE = """
import sys
from stlbench_agents.dqn import DQN
from stlbench_agents import llvm_kernels, layers, engine, replay, q_learner
DQN(head="additive").compile()
for module in (llvm_kernels, layers, engine, replay, q_learner):
    for name, function in vars(module).items():
        if hasattr(function, "py_func") and function.py_func.__module__ == module.__name__:
            print(name, len(function.signatures))
"""


@pytest.mark.slow
def test_no_function_is_compiled_for_two_kinds_of_arguments(tmp_path: Path) -> None:
    """A plain 0 is a type of its own, and a call with it compiles a function again, which only a clock would tell."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", ONCE], env=environment, capture_output=True, text=True, check=True)
    counts = dict(line.split() for line in done.stdout.splitlines())
    assert counts["inner_product"] == counts["gather"] == counts["_update_additive"] == "1"
    assert set(counts.values()) <= {"0", "1"}  # 0: what became a part of others


@pytest.mark.parametrize("kept", [None, Path("/proc/none")])
def test_where_nothing_can_be_kept_it_is_compiled_each_time(monkeypatch: pytest.MonkeyPatch, kept: Path | None) -> None:
    monkeypatch.setattr(compiled, "folder", lambda package: kept)
    compiled.note_ready("stlbench_agents", "td3")
    assert not compiled.is_ready("stlbench_agents", "td3")
