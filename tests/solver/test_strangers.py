"""Folders of `solve` from a stranger: no code of theirs runs, and nothing is written through their links."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from helpers import strangers

from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.solver.solution import Solution

FACTS = {"cell": "task/raw/dqn/0", "budget": "final"}


@pytest.fixture(autouse=True)
def importable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The working directory is searched for modules, as for a script that the user runs there."""
    monkeypatch.syspath_prepend(str(tmp_path))
    plugins._ADDED["tasks"].pop("task", None)


@pytest.mark.parametrize("kind", strangers.KINDS)
def test_a_solution_with_code_is_refused(tmp_path: Path, kind: str) -> None:
    strangers.plant(tmp_path / "out" / "task", kind, tmp_path)
    (tmp_path / "out" / "certificate.json").write_text(json.dumps(FACTS))
    with pytest.raises(UsageError, match=r"out: its task runs .*; if you trust it, load it with run_code=True$"):
        Solution.load("out")
    assert not (tmp_path / strangers.MARK).exists()
    assert "task" not in plugins.available("tasks")  # else the next command of this process would run it


@pytest.mark.parametrize("text", ["[]", "{}", '{"cell": 1, "budget": "final"}', '{"cell": "x", "budget": []}', "\0"])
def test_a_certificate_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    strangers.plant(tmp_path / "out" / "task", "none", tmp_path)
    (tmp_path / "out" / "certificate.json").write_text(text)
    with pytest.raises(UsageError, match="out has no solution"):
        Solution.load("out")
