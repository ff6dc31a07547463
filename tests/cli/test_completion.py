"""What a shell gets when someone presses the tab key."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from stlbench.cli import app


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("stlbench run --tasks toy", ["toy-line"]),
        ("stlbench run --methods raw,toy-r", ["raw,toy-raw"]),
        ("stlbench run --agents dqn,toy", ["dqn,toy-agent"]),
        ("stlbench show task toy", ["toy-line"]),
    ],
)
@pytest.mark.usefixtures("toy")
def test_names(typed: str, offered: list[str]) -> None:
    words = {"COMP_WORDS": typed, "COMP_CWORD": str(len(typed.split()) - 1)}
    ran = CliRunner().invoke(app, [], env={"_STLBENCH_COMPLETE": "complete_bash", **words}, prog_name="stlbench")
    assert ran.stdout.split() == offered


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_for_a_shell(shell: str) -> None:
    ran = CliRunner().invoke(app, [], env={"_STLBENCH_COMPLETE": f"source_{shell}"}, prog_name="stlbench")
    assert f"_STLBENCH_COMPLETE=complete_{shell}" in ran.stdout
