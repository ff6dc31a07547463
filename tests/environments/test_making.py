"""Environments by their id, and the software that they consist of."""

from __future__ import annotations

from importlib.metadata import version

import pytest

from stlbench.environments.making import made, software
from stlbench.errors import UsageError


def test_the_software_of_an_environment_is_what_its_modules_import() -> None:
    found = dict(software(made("Hopper-v5", {})))
    assert found["gymnasium"] == version("gymnasium")
    assert found["mujoco"] == version("mujoco")
    assert "numpy" not in found
    assert "mujoco" not in dict(software(made("CartPole-v1", {})))


def test_there_is_no_time_limit() -> None:
    env = made("CartPole-v1", {"sutton_barto_reward": True})
    assert "TimeLimit" not in str(env)


@pytest.mark.parametrize(
    ("identifier", "keywords", "said"),
    [
        ("CartPoel-v1", {}, "no environment 'CartPoel-v1'; did you mean 'CartPole-v1'"),
        ("CartPole-v1", {"gravity": 3}, "environment CartPole-v1 cannot be made: TypeError: .*gravity"),
        ("no_such_module:Pole-v0", {}, "environment no_such_module:Pole-v0 cannot be made: ModuleNotFoundError"),
        ("CartPole-v99", {}, "environment CartPole-v99 cannot be made: "),
    ],
)
def test_what_cannot_be_made_is_said_in_a_line(identifier: str, keywords: dict[str, int], said: str) -> None:
    with pytest.raises(UsageError, match=f"^{said}[^\n]*$"):
        made(identifier, keywords)
