"""Environments by their id, and the software that they consist of."""

from __future__ import annotations

import re
import subprocess
import sys
import types
from importlib.metadata import version

import pytest

from stlbench.errors import UsageError
from stlbench.task.file import Api
from stlbench.task.gym_make import _missing, made, software


def test_the_software_of_an_environment_is_what_its_modules_import() -> None:
    found = dict(software(made("Hopper-v5", {})))
    assert found["gymnasium"] == version("gymnasium")
    assert found["mujoco"] == version("mujoco")
    assert "numpy" not in found
    assert "mujoco" not in dict(software(made("CartPole-v1", {})))


def test_an_engine_counts_that_a_library_needs_whose_modules_do_not_import_it() -> None:
    found = dict(software(made("shimmy:dm_control/cartpole-balance-v0", {})))
    assert found["mujoco"] == version("mujoco")
    assert found["dm_control"] == version("dm_control")


def test_a_library_prints_no_notices_when_an_environment_is_made() -> None:
    code = "from stlbench.task.gym_make import made; made('gymnasium_robotics:AdroitHandDoor-v1', {})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "reward functions were updated" not in done.stdout + done.stderr


def test_there_is_no_time_limit() -> None:
    env = made("CartPole-v1", {"sutton_barto_reward": True})
    assert "TimeLimit" not in str(env)


@pytest.mark.parametrize(
    ("api", "identifier", "said"),
    [
        ("gymnasium", "shimmy:dm_control/cartpole-balance-v0", 'shimmy: pip install "stlbench-rl[dm]"'),
        ("gymnasium", "gymnasium_robotics:FetchReach-v4", 'gymnasium_robotics: pip install "stlbench-rl[mujoco]"'),
        ("pettingzoo", "mpe2.simple_spread_v3", 'mpe2: pip install "stlbench-rl[petting]"'),
    ],
)
def test_a_library_that_an_extra_brings_is_named_with_it(
    api: Api, identifier: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in (said.partition(":")[0], identifier.partition(":")[0]):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(UsageError, match=f"environment {identifier} needs {re.escape(said)}$"):
        made(identifier, {}, api)


@pytest.mark.parametrize(
    ("identifier", "keywords", "said"),
    [
        ("CartPoel-v1", {}, "no environment 'CartPoel-v1'; did you mean 'CartPole-v1'"),
        ("CartPole-v1", {"gravity": 3}, "environment CartPole-v1 cannot be made: TypeError: .*gravity"),
        ("no_such_module:Pole-v0", {}, "environment no_such_module:Pole-v0 cannot be made: ModuleNotFoundError"),
        ("no_such_module:Pole-v0", {}, ".*No module named 'no_such_module'; set PYTHONPATH=. if it lies here$"),
        ("gymnasium.no_such:Pole-v0", {}, ".* cannot be made: .* No module named 'gymnasium.no_such'"),
        ("mujoco.no_such:Pole-v0", {}, ".* cannot be made: .* No module named 'mujoco.no_such'"),  # mujoco is there
        ("CartPole-v99", {}, "no environment 'CartPole-v99'; did you mean 'CartPole-v1'"),
    ],
)
def test_what_cannot_be_made_is_said_in_a_line(identifier: str, keywords: dict[str, int], said: str) -> None:
    with pytest.raises(UsageError, match=f"^{said}[^\n]*$"):
        made(identifier, keywords)


def test_a_stub_of_a_library_is_no_missing_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "stub", types.ModuleType("stub"))
    assert _missing(ModuleNotFoundError("no stub.part", name="stub.part")) == ""
    assert _missing(ModuleNotFoundError("no nowhere.part", name="nowhere.part")) == "nowhere"
