"""What is compiled once: each agent says what is missing, until this machine has compiled it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from stlbench.contract import Agent
from stlbench_agents import compiled_code
from stlbench_agents.dqn import DQN
from stlbench_agents.independent import DQNPerRobot
from stlbench_agents.td3 import TD3


@pytest.fixture
def empty(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A machine that has compiled nothing: only the notes of it are elsewhere, so that the test compiles nothing."""
    monkeypatch.setattr(compiled_code, "folder", lambda: tmp_path / "new")
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
    assert len([path for path in empty.iterdir() if path.is_file()]) == 1


ONCE = """
import sys
from stlbench_agents.dqn import DQN
from stlbench_agents import llvm_kernels, layers, engine, optimizer, replay, q_learner
DQN(head="additive").compile()
for module in (llvm_kernels, layers, engine, optimizer, replay, q_learner):
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


def test_where_nothing_can_be_kept_it_is_compiled_each_time(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr(compiled_code, "folder", lambda: tmp_path / "file" / "in")
    compiled_code.note_ready("td3")
    assert not compiled_code.is_ready("td3")


def test_without_a_home_the_folder_is_a_temporary_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def home() -> Path:
        raise RuntimeError("no home directory")

    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(compiled_code.Path, "home", home)
    monkeypatch.setattr(compiled_code, "gettempdir", lambda: str(tmp_path))
    compiled_code.folder.cache_clear()
    assert compiled_code.folder().parent == tmp_path / "stlbench"
    compiled_code.folder.cache_clear()


def test_the_folder_is_another_for_other_sources(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    made = []
    for text in ("a = 1", "a = 2", "a = 1"):
        (tmp_path / "compiled_code.py").write_text(text, encoding="utf-8")
        monkeypatch.setattr(compiled_code, "__file__", str(tmp_path / "compiled_code.py"))
        compiled_code.folder.cache_clear()
        made.append(compiled_code.folder())
    compiled_code.folder.cache_clear()
    assert made[0] == made[2] != made[1]
    assert made[0].parent == tmp_path
